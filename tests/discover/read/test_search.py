"""Motions between two sides, found by their ranges, from wherever they are."""

import numpy as np
import pytest

from jaxsim.discover.read.registration import as_effects
from tests.discover.made_register import found
from tests.discover.rooms import registered, rooms, seen

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = 12
NAMES = [f"s{k}" for k in range(FRAMES)]


MOVED = (-0.2, 0.3, -0.3, 0, 0, -0.01)
OTHER_POSES = [(0, 0, 0, 0, 0, 0.035), (0, 0, 0, 0, 0.0087, 0), (0, 0, 0, -0.02, 0.01, 0.02), (0.5, 0, 0, 0, 0, 0)]


@pytest.mark.parametrize(
    ("pose", "strangers"),
    [
        *((pose, 0.15) for pose in (MOVED, *OTHER_POSES)),
        (MOVED, 0.0),
        # Without strangers a motion is found more easily than with them.
        *(pytest.param(pose, 0.0, marks=pytest.mark.slow) for pose in OTHER_POSES),
    ],
)
def test_a_mounting_is_found_within_its_interval(pose, strangers):
    one = found(np.array(pose), strangers=strangers)
    off = np.abs(one.motion[:6] - pose)
    assert (off < np.maximum(1.5 * one.half[:6], [0.02] * 3 + [0.001] * 3)).all()
    assert one.half.max() < 0.1
    planted = {"extrinsic_translation": pose[:3], "extrinsic_rotation": pose[3:]}
    assert one.sure == tuple(name for name, part in planted.items() if np.any(part))
    assert not one.early_or_late
    assert np.median(one.near) > 0.8 - strangers


@pytest.mark.parametrize("lift", [-0.0087, 0.0087])
def test_beams_that_all_point_half_a_degree_off_are_told_from_a_turned_sensor(lift):
    one = found(np.zeros(6), lift=lift)
    assert one.sure == ("beam_elevation_error",)
    assert one.motion[6] == pytest.approx(lift, abs=1.5e-3)
    assert "beams lifted by" in str(one)


def test_what_the_effects_of_a_mounting_say_is_the_same_motion():
    one = found(np.array([0.1, 0, 0, 0, 0, 0.03]))
    assert one.motion[0] == pytest.approx(0.1, abs=0.02)
    turned = as_effects(one.motion)["extrinsic_rotation"]
    assert turned["yaw_rad"] == pytest.approx(0.03, abs=1e-3)
    assert turned["roll_rad"] == pytest.approx(0, abs=1e-3)


def test_sides_of_one_place_stay():
    one = found(np.random.default_rng(3).normal(0, [0.02] * 3 + [0.001] * 3, (FRAMES, 6)))
    assert one.sure == ()
    assert one.speeds(NAMES) is None


def test_other_streets_do_not_agree_however_they_are_moved():
    ours = [seen(room) for room in rooms(FRAMES)]
    one = registered(ours, [seen(room[::-1] * 0.6) for room in rooms(FRAMES, seed=9)], NAMES)
    assert np.median(one.near) < 0.7
