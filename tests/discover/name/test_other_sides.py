"""What both sides say of each other is told from what one of them lacks."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover import discover
from jaxsim.discover.find.covariates import Dependence
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.mounting.constant import brought_back, place_mounting
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.discover.name.other_sides import OtherSides, alike, clearly_more
from jaxsim.discover.name.select import fitted_step
from jaxsim.discover.name.unexplained import free_curves
from jaxsim.discover.read import Comparison
from jaxsim.discover.rules import RULES
from jaxsim.effects import get_effect, scan_of
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import PolarImage
from tests.discover.noisy_street import disturbed, grid, street
from tests.discover.rooms import GRID, STILL, measured_of, registered, rooms, seen

pytestmark = pytest.mark.long

few_rays = pytest.mark.usefixtures("few_rays_here")
"""Of what is found in half of them by thrice what it must gain and more; the others need all."""
FRAMES = 12
NOISE = {"share": 0.06, "constant": 0.004, "range_m": 0.015, "loss": 0.01}
NEAR_M = 4.0


def read(frame, borders, rng, *, mixed, noise=NOISE):
    """A noisy reading of a street with boxes, of whose border rays a share lies between box and background."""
    range_m, intensity, kept = disturbed(frame, rng, **noise)
    behind = frame["behind"]
    there = borders & kept & (rng.random(kept.shape) < mixed)
    between = NEAR_M + rng.random(kept.shape) * (behind - NEAR_M)
    return np.where(there, between, range_m), intensity, kept


def sides(*, mixed=(0.15, 0.15), loss=NOISE["loss"], own=0.0, simulator=NOISE) -> Comparison:
    """Streets with boxes; `mixed` of simulation and measurement, rays that the sensor loses, the standard deviation of
    what walls are brighter than the simulator knows, nats, and the noise of the simulator."""
    rng = np.random.default_rng(5)
    images, more, measured = [], [], []
    for k in range(FRAMES):
        frame = street(k)
        box = np.zeros(frame["hit"].shape, bool)
        for start in rng.choice(np.arange(4, 470, 16), 14, replace=False):
            box[:, start : start + 8] = True
        box &= frame["range"] > NEAR_M + 2
        borders = box & ~(np.roll(box, 1, 1) & np.roll(box, -1, 1))
        frame = frame | {"behind": frame["range"], "range": np.where(box, NEAR_M, frame["range"])}
        range_m, intensity, kept = read(frame, borders, rng, mixed=mixed[0], noise=simulator)
        images.append(PolarImage(range_m.astype("f4"), intensity.astype("f4"), kept))
        more.append({"semantic": frame["semantic"], "incidence": frame["incidence"].astype("f4")})
        brighter = np.exp(own * rng.normal(0, 1, 60))[(np.arange(480) // 8)][None]
        bright = frame | {"intensity": np.clip(frame["intensity"] * brighter, 0, 1)}
        measured.append(read(bright, borders, rng, mixed=mixed[1], noise=NOISE | {"loss": loss}))
    names = tuple(f"{k:03d}" for k in range(FRAMES))
    parts = (np.stack([one[k] for one in measured]).astype(bool if k == 2 else "f4") for k in range(3))
    return Comparison(scan_of(grid(), images, more), Measured(*parts), names, names)


def asked(comparison, name):
    """Whether the exchanged sides have an effect that was fitted, and its step."""
    null_model = NullModel.of(Division.of(comparison))
    [best] = rank_effects(null_model.problem, [get_effect(name)])
    step = fitted_step(null_model.problem, best, ranking=[best], among=[best])
    back = brought_back if comparison.other_moments else None
    return OtherSides.exchanged(comparison, null_model, back=back), step


def of_other_moments(*, simulated_m, measured_m) -> Comparison:
    """Rooms seen by a sensor that stood 1 to 4 m further on, whose beams read too far by so much on either side, m."""
    rng, streets = np.random.default_rng(3), rooms(FRAMES)
    names = tuple(f"{k:03d}" for k in range(FRAMES))
    poses = [(ahead, *STILL[1:]) for ahead in np.linspace(1, 4, FRAMES)]
    ours = [seen(room, noise_m=0.01, rng=rng) for room in streets]
    theirs = [seen(room, pose, noise_m=0.01, rng=rng) for room, pose in zip(streets, poses, strict=True)]
    ours = [replace(one, range_m=(one.range_m + simulated_m[:, None]).astype("f4")) for one in ours]
    theirs = [replace(one, range_m=(one.range_m + measured_m[:, None]).astype("f4")) for one in theirs]
    given = Comparison(
        scan_of(GRID, ours), measured_of(theirs), names, names, registration=registered(ours, theirs, names)
    )
    return place_mounting(given, ()).comparison


BEAMS_M = np.random.default_rng(1).normal(0, 0.04, len(GRID.elevation_rad))


@few_rays
def test_what_casting_makes_of_beams_that_differ_is_found_with_the_sides_exchanged_too():
    same = of_other_moments(simulated_m=BEAMS_M, measured_m=BEAMS_M)
    assert same.other_moments
    exchanged, step = asked(same, "beam_range_bias")
    assert step.chosen.total > RULES.bar_nats
    assert exchanged.has(step, exchanged.null_model.problem)


@few_rays
def test_beams_that_are_off_on_one_side_are_no_matter_of_casting():
    exchanged, step = asked(of_other_moments(simulated_m=0 * BEAMS_M, measured_m=BEAMS_M), "beam_range_bias")
    assert step.chosen.total > RULES.bar_nats
    assert not exchanged.has(step, exchanged.null_model.problem)


@pytest.mark.slow  # The whole answer below says so of the same streets.
def test_edges_that_both_sides_mix_are_nothing_that_one_lacks():
    exchanged, step = asked(sides(), "mixed_pixels")
    assert step.chosen.total > 10
    assert exchanged.has(step, exchanged.null_model.problem)


def test_what_the_control_shows_as_well_is_not_new():
    """Too weak to be named there, it is found in the mean of its scenes."""
    both, new = sides(mixed=(0.0, 0.3)), sides(mixed=(0.0, 0.0))
    null_model = NullModel.of(Division.of(both))
    [best] = rank_effects(null_model.problem, [get_effect("mixed_pixels")])
    step = fitted_step(null_model.problem, best, ranking=[best], among=[best])
    assert OtherSides.of_control(both).has(step, null_model.problem)
    assert not OtherSides.of_control(new).has(step, null_model.problem)


@pytest.mark.parametrize(("apart", "clear"), [(0.0, False), (0.5, False), (4.0, True)])
def test_scenes_must_tell_themselves_from_the_controls(apart, clear):
    rng = np.random.default_rng(2)
    there, here = rng.normal(apart, 1, 9), rng.normal(0, 1, 12)
    assert clearly_more(there, here) == clear
    # Less is not more.
    assert not clearly_more(here, there)


def test_two_alike_groups_of_scenes_pass_as_rarely_as_the_rule_says():
    rng = np.random.default_rng(3)
    passed = [clearly_more(rng.normal(0, 1, 8), rng.normal(0, 1, 8)) for _ in range(400)]
    # At 0.002 more than five of 400 are a matter of one in a thousand.
    assert sum(passed) <= 5


def test_the_answer_is_none_and_a_note_says_what_was_found(standard_promotion):
    """Also where the sensor model holds effects already, as in a second round."""
    known = SensorModel((("random_dropout", {"probability": 0.001}),))
    verdict = discover(sides(), effects=("mixed_pixels",), known=known).verdict
    assert verdict.verdict == "none"
    assert verdict.effects == ()
    [note] = [line for line in verdict.notes if line.startswith("found, and not said")]
    assert "mixed_pixels" in note
    why = {rank.name: rank.why_not for rank in verdict.ranking}
    assert why["mixed_pixels"] == "with the sides exchanged it is found as well"


@few_rays
def test_what_the_sensor_alone_mixes_is_its_own():
    exchanged, step = asked(sides(mixed=(0.0, 0.15)), "mixed_pixels")
    assert step.chosen.total > 10
    assert not exchanged.has(step, exchanged.null_model.problem)


@few_rays
@pytest.mark.parametrize(("ours", "found"), [(0.15, True), (0.0, False)])
def test_what_beams_meet_by_chance_is_asked_of_a_simulator_without_noise_too(ours, found):
    """Crowns and fences, of which each side sees another draw."""
    exchanged, step = asked(sides(mixed=(ours, 0.15), simulator={}), "mixed_pixels")
    assert exchanged.channels.isdisjoint({"range"})
    assert step.chosen.total > 10
    assert exchanged.has(step, exchanged.null_model.problem) == found


def crowns(ours: float, *, noise=(NOISE, NOISE)) -> Comparison:
    """Streets below crowns before the sky, of which the sensor's rays meet half, and the simulator's a share; with the
    noise of simulation and measurement."""
    rng = np.random.default_rng(8)
    images, more, measured = [], [], []
    for k in range(FRAMES):
        frame = street(k)
        crown = ~frame["hit"] & (np.arange(480) % 40 < 20)
        leaf_m = 12 + 2 * rng.random(crown.shape)
        frame = frame | {
            "range": np.where(crown, leaf_m, frame["range"]),
            "intensity": np.where(crown, 0.2, frame["intensity"]),
            "semantic": np.where(crown, 21, frame["semantic"]),
        }
        both = [frame | {"hit": frame["hit"] | (crown & (rng.random(crown.shape) < share))} for share in (ours, 0.5)]
        images.append(PolarImage(*map(_as_read, disturbed(both[0], rng, **noise[0]))))
        more.append({"semantic": frame["semantic"], "incidence": frame["incidence"].astype("f4")})
        measured.append([*map(_as_read, disturbed(both[1], rng, **noise[1]))])
    names = tuple(f"{k:03d}" for k in range(FRAMES))
    return Comparison(
        scan_of(grid(), images, more), Measured(*map(np.stack, zip(*measured, strict=True))), names, names
    )


def _as_read(of: np.ndarray) -> np.ndarray:
    return of if of.dtype == bool else of.astype(np.float32)


@pytest.mark.parametrize(("ours", "found"), [(0.5, True), (1.0, False)])
def test_leaves_that_each_side_meets_by_chance_are_no_loss_of_the_sensor(ours, found):
    exchanged, step = asked(crowns(ours), "material_dropout")
    assert step.chosen.total > 10
    assert exchanged.has(step, exchanged.null_model.problem) == found


@pytest.mark.parametrize(("ours", "found"), [(0.5, True), (1.0, False)])
def test_nor_are_they_a_curve_of_losses_beside_a_simulator_without_noise(ours, found):
    comparison = crowns(ours, noise=({}, NOISE | {"loss": 0.0}))
    null_model = NullModel.of(Division.of(comparison))
    by_class = [Dependence("drop", "class", 1.0, 0.0, 0.0)]
    [(along, curve)] = [pair for pair in free_curves(null_model.problem, by_class) if pair[0].covariate == "class"]
    exchanged = OtherSides.exchanged(comparison, null_model)
    assert "drop" not in exchanged.channels
    assert curve.total > 10
    assert exchanged.has_curve(null_model.problem, along, curve) == found


@few_rays
def test_rays_that_the_sensor_alone_loses_are_its_own():
    exchanged, step = asked(sides(loss=0.08), "random_dropout")
    assert step.chosen.total > 10
    assert not exchanged.has(step, exchanged.null_model.problem)


@pytest.mark.parametrize(("own", "channels"), [(0.0, {"range", "drop", "intensity"}), (0.4, {"range", "drop"})])
def test_intensities_are_asked_only_where_both_sides_know_how_bright_surfaces_are(own, channels):
    division = Division.of(sides(own=own))
    assert alike(division, NullModel.of(division).problem) == channels
