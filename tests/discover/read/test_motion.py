"""Least squares for a motion near where they begin."""

import numpy as np
import pytest

from jaxsim.discover.read.motion import COARSE, MOUNTED, climb, loss
from jaxsim.discover.read.registration import NUMBERS, sides_of
from jaxsim.effects.scan import scan_of
from tests.discover.rooms import GRID, measured_of, rooms, seen

pytestmark = pytest.mark.usefixtures("standard_promotion")


def test_a_climb_ends_where_points_lie_on_their_planes():
    pose = (0.1, -0.05, 0.02, 0.0, 0.004, 0.01)
    measured = measured_of([seen(room, pose) for room in rooms(4)])
    sides = sides_of(scan_of(GRID, [seen(room) for room in rooms(4)]), measured.range_m, measured.valid)
    still = np.zeros((1, NUMBERS))
    moved = climb(sides, still, COARSE, free=MOUNTED, pooled=True)
    np.testing.assert_allclose(moved[0, :6], pose, atol=3e-3)
    assert loss(sides, moved, COARSE[-1]).mean() < 0.3 * loss(sides, still, COARSE[-1]).mean()


def test_frames_that_climb_for_themselves_end_where_each_alone_does():
    poses = [(0.1 * k, -0.05, 0.0, 0.0, 0.0, 0.01 * k) for k in range(3)]
    streets = list(rooms(3))
    measured = measured_of([seen(room, pose) for room, pose in zip(streets, poses, strict=True)])
    sides = sides_of(scan_of(GRID, [seen(room) for room in streets]), measured.range_m, measured.valid)
    still = np.zeros((3, NUMBERS))
    together = climb(sides, still, COARSE, free=MOUNTED, pooled=False)
    alone = [
        climb(sides.of_frames(slice(k, k + 1)), still[:1], COARSE, free=MOUNTED, pooled=False)[0] for k in range(3)
    ]
    np.testing.assert_allclose(together, alone, atol=1e-9)
