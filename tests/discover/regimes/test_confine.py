"""What scenes and sectors ask for, and an effect fitted where it acts."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.model.fit import fit
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.discover.regimes.cells import cells_of
from jaxsim.discover.regimes.chance import best_region, likeness_p_value, scenes_by_size
from jaxsim.discover.regimes.confine import confine, named_in_part
from jaxsim.discover.regimes.questions import questions
from jaxsim.discover.regimes.sizes import sized, sizes_at
from jaxsim.effects import EFFECTS
from jaxsim.effects.region import Region
from tests.discover.name.made import candidate
from tests.discover.regimes.halves import COLUMNS, FRAMES, GAINS, INSIDE, SECTOR, halves

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]
GAIN = EFFECTS["beam_gain"]


@pytest.fixture(scope="module")
def night(standard_promotion):
    return halves()


def asked(null, facts):
    """The best region of every question, of beam gains fitted to all frames; by what divides."""
    one = fit(GAIN, null)
    of = cells_of(GAIN, null, one, sector=facts.sector, sectors=facts.sectors)
    found = [best_region(q, of, facts.scene) for q in questions(facts)]
    # Moments are asked about twice, from one on and between two: the clearer answer comes last and stays.
    found.sort(key=lambda one: -one.p_value)
    return of, {(one.question.divides, one.question.regions[0].tag): one for one in found}


def test_the_moment_and_the_tag_that_divide_are_found_and_no_other(night):
    null, facts = night
    _, found = asked(null, facts)
    time = found["time", None]
    first, last = time.question.regions[time.k].time_s
    assert 30 * 4 < first < 30 * 5  # toy frames are 30 s apart
    assert last is None
    assert time.p_value < 0.01
    assert found["tag", "night"].p_value < 0.01
    assert found["tag", "rain"].p_value > 0.1
    assert found["azimuth", None].p_value > 0.01


def test_a_sector_that_has_the_effect_is_found_to_a_few_columns(standard_promotion):
    null, facts = halves(np.ones(FRAMES, bool), SECTOR)
    _, found = asked(null, facts)
    arc = found["azimuth", None]
    held = np.asarray(arc.question.regions[arc.k].in_sector(facts.scan.grid.azimuth_rad))
    assert arc.p_value < 0.01
    assert (held != SECTOR).sum() <= 0.1 * COLUMNS
    assert found["time", None].p_value > 0.01


def test_fitted_in_its_part_an_effect_is_as_large_as_it_is_there(night):
    null, facts = night
    _, found = asked(null, facts)
    time = found["time", None]
    [candidate] = rank_effects(null, [GAIN])
    one = confine(null, [candidate], time.question.regions[time.k], facts=facts, ranking=[candidate])
    assert one is not None
    assert one.advantage > 10
    gain = np.asarray(to_values(GAIN, one.step.fit.z)["gain"])
    slope = np.polyfit(GAINS - GAINS.mean(), gain - gain.mean(), 1)[0]
    assert slope == pytest.approx(1, abs=0.1)
    told = sized(one, facts)
    inside, outside = told.inside, told.outside
    assert inside.low < 1 < inside.high
    assert outside.low < 0 < outside.high
    assert outside.high < 0.2


def test_places_inside_ask_for_the_size_inside_and_those_outside_for_none(standard_promotion):
    """With one size everywhere the levels of what all streets have would lie between, and serve neither."""
    null, facts = halves(share=0.0, falloff=0.6)
    falloff = EFFECTS["range_falloff"]
    [candidate] = rank_effects(null, [falloff])
    one = confine(null, [candidate], Region(time_s=(135.0, None)), facts=facts, ranking=[candidate])
    assert one is not None
    of_column = np.broadcast_to(facts.scene[:, None], facts.column.shape)
    size = sizes_at(sized(one, facts).slopes, of_column, FRAMES)
    np.testing.assert_allclose(size, INSIDE, atol=0.35)


def test_in_a_part_as_everywhere_the_simplest_name_is_given_of_those_that_gain_as_much():
    light = candidate("ambient_light", 28.0, "drop")
    threshold = candidate("snr_dropout", 67.5, "drop", numbers=4)
    loss = candidate("random_dropout", 67.4, "drop", numbers=1)
    assert named_in_part(light, [threshold, loss, light]) is loss
    assert named_in_part(threshold, [threshold, loss, light]) is loss
    # What was asked about stays where nothing is clearly better.
    stronger = candidate("snr_dropout", 67.5, "drop", numbers=1)
    assert named_in_part(loss, [stronger, loss, light]) is loss


def test_what_acts_everywhere_is_not_confined(standard_promotion):
    null, facts = halves(np.ones(FRAMES, bool))
    facts = replace(facts, scan=replace(facts.scan, tags={"night": INSIDE}))
    _, found = asked(null, facts)
    [candidate] = rank_effects(null, [GAIN])
    tag = found["tag", "night"].question.regions[0]
    assert confine(null, [candidate], tag, facts=facts, ranking=[candidate]) is None


def test_scenes_that_tell_little_do_not_resemble_themselves_by_scattering_more():
    rng = np.random.default_rng(0)
    by_noise = []
    for _ in range(200):
        scatter = np.exp(rng.normal(0, 1.5, 24))
        by_noise.append(likeness_p_value(rng.normal(0, scatter), rng.normal(0, scatter)))
    # Of 200 at 0.05, ten and twice their scatter.
    assert np.sum(np.array(by_noise) <= 0.05) <= 16
    own = 3.0 * (np.arange(24) % 3 == 0)
    assert likeness_p_value(own + rng.normal(size=24), own + rng.normal(size=24)) < 0.01


def test_drives_that_nothing_tells_apart_are_told_by_their_own_readings():
    some = np.isin(np.arange(FRAMES), [0, 3, 4, 8])
    null, facts = halves(some)
    one = fit(GAIN, null)
    halved = 2 * facts.sector + np.arange(facts.sector.shape[1]) % 2
    of = cells_of(GAIN, null, one, sector=halved, sectors=2 * facts.sectors)
    found = scenes_by_size(of, facts)
    assert found is not None
    assert found.p_value < 0.02
    assert found.question.regions[0].scenes == ("drive 0", "drive 3", "drive 4", "drive 8")
