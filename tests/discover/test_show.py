"""Judge scenes say nothing of effects that are not there."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.read import Comparison
from jaxsim.discover.show import (
    WHY_NOT,
    effects_model_of,
    gap_with,
    judged_by_reported,
    with_placed,
    without_unconfirmed,
)
from jaxsim.discover.verdict import CurveLine, Interval
from jaxsim.effects import EFFECTS
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.region import Region
from tests.discover.toy import toy
from tests.discover.verdicts import effect, verdict
from tests.report.made_regimes import regime

pytestmark = pytest.mark.long

FRAMES = 12


@pytest.fixture(scope="module")
def shown(standard_promotion):
    scan, measured = toy(FRAMES)
    names = tuple(f"frame {k}" for k in range(FRAMES))
    division = Division.of(Comparison(scan, measured, names, names))
    null_model = NullModel.of(division)
    return gap_with(null_model, [], null_model.problem.noise)


def test_without_an_effect_the_gap_stays_and_there_is_no_closure(shown):
    assert shown.closure is None
    for gap in shown.gap.values():
        assert gap.before == gap.after == gap.placebo
        assert gap.gained.value == 0
    assert shown.curves == ()


def test_maps_before_and_after_are_then_the_same(shown):
    for channel, before in shown.maps_before.items():
        np.testing.assert_array_equal(before, shown.maps_after[channel])


def test_frames_are_shown_ray_by_ray_with_the_residuals_that_the_maps_are_means_of(shown):
    assert 1 <= len(shown.frames) <= 4
    assert len({frame.name for frame in shown.frames}) == len(shown.frames)
    for frame in shown.frames:
        cells = frame.row * 10_000 + frame.column
        assert len(np.unique(cells)) == len(cells) > 100
        assert (frame.range_m > 0).all()
        for channel, before in frame.before.items():
            np.testing.assert_array_equal(before, frame.after[channel])
        # A lost ray has no reading to compare.
        assert np.isnan(frame.before["range"][~frame.returned]).all()
        assert abs(np.nanmean(frame.before["range"])) < 0.05


def test_rays_fall_into_the_groups_of_a_curve():
    x = np.array([0.5, 1.5, 3.0])
    curve = CurveLine("range", "row", "m", x, x, x, x, edges=np.array([0.0, 1.0, 2.0, np.inf]))
    assert curve.group_of(np.array([[0.0, 0.9], [1.0, 7.0]])).tolist() == [[0, 0], [1, 2]]
    assert CurveLine("range", "row", "m", x, x, x, x).group_of(x).tolist() == [-1, -1, -1]


GAIN = effect("beam_gain", "intensity")


@pytest.mark.parametrize("low", [0.5, -0.5])
def test_what_judge_scenes_gain_by_in_the_mean_stays_named(low):
    one = verdict(low, GAIN)
    assert without_unconfirmed(one) is one


@pytest.mark.parametrize("low", [-0.8, -1.0, -1.5])
def test_what_they_do_not_gain_by_is_kept_and_not_named(low):
    one = without_unconfirmed(verdict(low, GAIN))
    assert (one.verdict, one.effects, one.unconfirmed) == ("none", (), (GAIN,))
    assert "not confirmed on unseen scenes: beam_gain" in one.notes[-1]
    assert [rank.why_not for rank in one.ranking] == [WHY_NOT, "weak"]
    assert one.to_json()["unconfirmed"][0]["name"] == "beam_gain"


def test_a_gain_in_a_channel_that_no_named_effect_has_does_not_count():
    assert without_unconfirmed(verdict(0.5, effect("range_noise", "range"))).verdict == "none"


@pytest.mark.parametrize(("nats", "verdict_"), [(3.0, "named"), (-3.0, "none")])
def test_what_follows_the_reported_intensity_is_judged_by_it(nats, verdict_):
    """The gap is that of simulations, which know the simulated intensity alone."""
    walk = effect("range_walk", "range")
    assert without_unconfirmed(verdict(-nats, walk), {"range_walk": nats}).verdict == verdict_


@pytest.mark.usefixtures("standard_promotion")
def test_effects_that_follow_the_reported_intensity_alone_are_judged_by_it(stages):
    null, added = stages.placed.found.null_model, stages.completed.added
    assert judged_by_reported(null, added) == {}
    walk, [one] = EFFECTS["range_walk"], added.refits
    rows = null.problem.ev.rays.row.shape[-1]
    neutral = replace(one, effect=walk, fit=replace(one.fit, z=to_z(walk, {}, rows), noise=null.problem.noise))
    shifted = replace(neutral, fit=replace(neutral.fit, z=to_z(walk, {"amplitude_m": 0.3}, rows)))
    assert judged_by_reported(null, replace(added, refits=(neutral,)))["range_walk"] == pytest.approx(0, abs=0.1)
    # Losses that another effect explains are in place beside it, and so is the noise that is left of them.
    loss = EFFECTS["random_dropout"]
    others = replace(one, effect=loss, fit=replace(one.fit, z=to_z(loss, {"probability": 0.3}, rows)))
    noise = null.problem.noise
    beside = replace(neutral, fit=replace(neutral.fit, noise=replace(noise, drop=noise.drop - 5)))
    assert judged_by_reported(null, replace(added, refits=(beside, others)))["range_walk"] == pytest.approx(0, abs=0.1)
    assert abs(judged_by_reported(null, replace(added, refits=(shifted,)))["range_walk"]) > 1


def test_nothing_named_needs_no_confirmation():
    one = verdict(-1.0)
    assert without_unconfirmed(one) is one


def test_a_mounting_is_named_before_what_was_found_with_it_in_place():
    turn = effect("extrinsic_rotation", "range", yaw_rad=Interval(0.02, 0.01, 0.03, "rad"))
    added = SensorModel((("beam_gain", {"gain": (0.1,)}),))
    one = with_placed(verdict(0.5, GAIN), (turn,), how="by its ranges")
    assert [e.name for e in one.effects] == ["extrinsic_rotation", "beam_gain"]
    assert one.notes[-1] == "extrinsic_rotation: by its ranges"
    assert with_placed(one, (), how="not at all") is one
    model = effects_model_of(one, added, SensorModel())
    assert model.effects == (("extrinsic_rotation", {"yaw_rad": 0.02}), ("beam_gain", {"gain": (0.1,)}))
    alone = with_placed(without_unconfirmed(verdict(-1, GAIN)), (turn,), how="")
    assert (alone.verdict, len(alone.effects), alone.unconfirmed) == ("named", 1, (GAIN,))
    assert [name for name, _ in effects_model_of(alone, added, SensorModel()).effects] == ["extrinsic_rotation"]
    unsure = with_placed(replace(verdict(-1), ranking=()), (), (turn,), how="")
    assert (unsure.verdict, unsure.unconfirmed) == ("none", (turn,))


def test_what_is_not_confirmed_leaves_no_region_behind():
    late, half = Region(time_s=(90.0, None)), Region(azimuth_rad=(0.0, 1.0))
    one = without_unconfirmed(replace(verdict(-1, GAIN), regimes=(regime(late),)))
    assert (one.unconfirmed, one.regimes) == ((GAIN,), ())
    known = SensorModel((("random_dropout", {"probability": 0.1}),), regions={"random_dropout": half})
    added = SensorModel((*known.effects, ("beam_gain", {"gain": 0.1})), regions={**known.regions, "beam_gain": late})
    assert effects_model_of(one, added, known) == known
    stays = replace(verdict(0.5, GAIN), regimes=(regime(late),))
    assert without_unconfirmed(stays).regimes
    assert effects_model_of(stays, added, known) is added
