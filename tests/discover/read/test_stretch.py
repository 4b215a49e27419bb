"""Ranges that are all too long, told from a sensor that stands elsewhere, also where it looks ahead alone."""

import numpy as np
import pytest

from jaxsim.discover.read.registration import sides_of
from jaxsim.discover.read.search import register
from jaxsim.discover.read.stretch import shrunk, stretch_of
from jaxsim.effects.scan import scan_of
from tests.discover.rooms import GRID, NAMES, STILL, measured_of, rooms, seen

pytestmark = pytest.mark.usefixtures("standard_promotion")
AHEAD = slice(60, 120)
"""Columns that look 60 degrees to each side."""


def part(image, stretch):
    """What of a frame lies ahead, its ranges too long by a share."""
    cut = image.replace(range_m=image.range_m[:, AHEAD] * np.float32(1 + stretch))
    return cut.replace(intensity=image.intensity[:, AHEAD], valid=image.valid[:, AHEAD])


def ahead(pose, stretch):
    """A scan ahead, and the ranges of a sensor at `pose` that reads too far: metres, and where it reads."""
    rng = np.random.default_rng(2)
    streets = rooms(len(NAMES))
    scan = scan_of(GRID.replace(azimuth_rad=GRID.azimuth_rad[AHEAD]), [part(seen(room), 0.0) for room in streets])
    measured = measured_of([part(seen(room, pose, noise_m=0.01, rng=rng), stretch) for room in streets])
    return scan, measured.range_m, measured.valid


@pytest.mark.parametrize(("pose", "stretch"), [(STILL, 0.01), ((0.3, 0, 0, 0, 0, 0), -0.02), (STILL, 0.0)])
def test_a_stretch_is_found_within_its_interval_beside_any_place(pose, stretch):
    sides = sides_of(*ahead(pose, stretch))
    found = stretch_of(sides, np.arange(len(NAMES)))
    assert found.share == pytest.approx(stretch, abs=1.5 * found.half + 5e-4)
    assert found.sure == bool(stretch)
    np.testing.assert_allclose(shrunk(sides, found.share).range_m * (1 + found.share), sides.range_m)


@pytest.mark.parametrize("stretch", [0.01, -0.02])
def test_ranges_that_are_too_long_do_not_move_a_sensor_that_looks_ahead(stretch):
    found = register(*ahead(STILL, stretch), scenes=NAMES)
    assert found.sure == ()
    assert not found.early_or_late
    np.testing.assert_allclose(found.motion[:3], 0, atol=0.05)


def test_a_moved_sensor_that_looks_ahead_is_still_found():
    found = register(*ahead((0.4, 0, 0, 0, 0, 0), 0.0), scenes=NAMES)
    assert found.sure == ("extrinsic_translation",)
    assert found.motion[0] == pytest.approx(0.4, abs=0.05)
