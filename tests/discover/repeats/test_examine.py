"""The whole method where something repeats: *not in the catalogue*, added, gone when it is fed back. Of the same frames
without it, tests/discover/test_workflow.py asks."""

import inspect
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind.hidden import make_case
from jaxsim.cli import main
from jaxsim.discover import discover, read_comparison
from jaxsim.discover.add import Added
from jaxsim.discover.repeats.examine import left_open, size_of, with_repeats
from jaxsim.discover.repeats.learn import LearnedRepeat
from jaxsim.discover.repeats.maps import Maps
from jaxsim.discover.verdict import Interval
from jaxsim.effects import EFFECTS
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.learned import Learned
from jaxsim.effects.own import known_effects
from jaxsim.effects.region import Region
from tests.effects.own import forgetful  # noqa: F401  (a fixture)

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("few_rays", "standard_promotion")]
FEW = ("range_scale",)
"""A candidate that has nothing to do with it, so that naming takes seconds."""
ROWS, COLUMNS, PERIODS, SHARE = 24, 192, 16, 0.2


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden") / "case"
    make_case(folder, effect="none", severity=1.0, seed=12, nuisance="exact", scenes=12, rows=ROWS, columns=COLUMNS)
    return read_comparison(folder / "simulated", folder / "measured")


@pytest.fixture(scope="module")
def rippled(plain):
    """The same with a gain that ripples over the columns."""
    wave = 1 + SHARE * np.sin(2 * np.pi * PERIODS * np.arange(COLUMNS) / COLUMNS + 0.7)
    light = np.clip(plain.measured.intensity * wave, 0, 1).astype(np.float32)
    return replace(plain, measured=replace(plain.measured, intensity=light))


@pytest.fixture(scope="module")
def answer(rippled, few_rays, standard_promotion):
    return discover(rippled, effects=FEW)


def test_a_ripple_is_not_none_and_told_with_its_period_and_size(answer):
    verdict = answer.verdict
    assert verdict.verdict == "not_in_catalogue"
    assert not verdict.effects
    one = verdict.repeats[0]
    assert (one.channel, one.along, one.period) == ("intensity", "column", COLUMNS / PERIODS)
    assert one.size.value == pytest.approx(SHARE, rel=0.05)
    assert one.size.low < one.size.value < one.size.high
    assert (verdict.unexplained.channel, verdict.unexplained.character) == ("intensity", "periodic")
    assert verdict.unexplained.covariate == "column"


def test_the_law_is_added_and_judge_scenes_gain(answer, tmp_path):
    law = answer.effects_model.learned[0]
    assert (law.kind, law.covariates) == ("wave", ("column",))
    assert np.hypot(*law.values) == pytest.approx(SHARE, rel=0.05)
    assert answer.verdict.learned == answer.effects_model.learned
    gained = answer.verdict.gap["intensity"].gained
    assert gained.low > 0
    assert gained.win_rate == 1
    answer.effects_model.save(tmp_path / "sensor.json")
    assert SensorModel.load(tmp_path / "sensor.json", rows=ROWS) == answer.effects_model


def test_fed_back_nothing_is_missing(answer, rippled):
    again = discover(rippled, effects=FEW, known=answer.effects_model)
    assert again.verdict.verdict == "none"
    assert not again.verdict.repeats


# Of a learned curve tests/cli/test_new_from_verdict.py checks the file everyday.
@pytest.mark.parametrize("checked", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_its_formula_becomes_an_effect_of_ones_own(answer, tmp_path, checked, forgetful):  # noqa: F811
    verdict = answer.verdict.save(tmp_path)
    main(["effects", "new", "ripple", "--from", str(verdict), "--out", str(tmp_path / "ripple.py")])
    if checked:
        main(["effects", "check", str(tmp_path / "ripple.py")])
    own = known_effects([tmp_path / "ripple.py"])["ripple"]
    assert own.covariates == ("column",)
    assert own.starts[0]["period"] == COLUMNS / PERIODS


def test_other_maps_show_a_share_of_a_pattern_with_its_sign():
    rng = np.random.default_rng(0)
    pattern = rng.normal(size=(6, 1)) + np.zeros((6, 40))
    pattern -= pattern.mean()
    one = object.__new__(LearnedRepeat)
    object.__setattr__(one, "pattern", pattern)
    weight = rng.uniform(1, 3, (5, 6, 40))
    for share in (-1.0, 0.0, 0.6):
        assert size_of(one, Maps.plain(weight, share * pattern + np.full_like(weight, 0.2))) == pytest.approx(
            share, abs=1e-6
        )
    assert size_of(one, Maps.plain(np.zeros_like(weight), weight)) == 0


def test_effects_keep_their_regions_beside_what_repeats():
    regions = {"beam_gain": Region(azimuth_rad=(0.0, 1.0))}
    sensor = SensorModel((("beam_gain", {"gain": 0.1}),), regions=regions)
    wave = Learned("intensity", "wave", ("column",), ((0.1,),), (0.3, -0.2), (0.0, 0.0))
    both = with_repeats(Added((), (), sensor), [wave]).effects_model
    assert (both.effects, both.learned, both.regions) == (sensor.effects, (wave,), regions)


@pytest.mark.parametrize(
    ("name", "channel", "size", "scale", "open_"),
    [
        ("beam_dropout", "drop", 0.09, "row", True),  # 0.09 of what 0.38 leaves, where the beam's is known to 0.07
        ("beam_dropout", "drop", 0.13, "row", False),
        ("beam_dropout", "drop", 0.09, "cell", False),
        ("beam_gain", "intensity", -0.06, "row", True),
        ("beam_gain", "range", 0.06, "row", False),  # of another channel
        ("beam_elevation_error", "range", 0.06, "row", False),  # a turn is no distance
        ("random_dropout", "drop", 0.01, "row", False),  # one number for all
    ],
)
def test_a_beam_whose_number_rests_on_few_columns_leaves_no_pattern_of_its_row(name, channel, size, scale, open_):
    beams = tuple(Interval.about(0.38 if row == 2 else 0.0, 0.07, "") for row in range(4))
    effect = EFFECTS[name]
    told = {key: beams if p.shape == "row" else beams[2] for key, p in effect.parameters.items()}
    added = SimpleNamespace(refits=(SimpleNamespace(effect=effect),), parameters=(told,))
    pattern = np.zeros((4, 6))
    pattern[2] = size
    repeat = SimpleNamespace(channel=channel, scale=scale, size=SimpleNamespace(value=size))
    found = SimpleNamespace(repeat=repeat, pattern=pattern)
    assert inspect.unwrap(left_open)(found, added) == open_
