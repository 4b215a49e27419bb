"""Frames as they would be seen from elsewhere, held against frames that were cast there."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxsim.discover.model.moved import same_surfaces, seen_from
from jaxsim.effects.scan import scan_of
from jaxsim.frame import PolarImage
from tests.discover.rooms import GRID, measured_of, rooms, seen

pytestmark = pytest.mark.usefixtures("standard_promotion")
POSES = np.array([[0.4, -0.2, 0.1, 0, 0, 0], [0, 0, 0, 0.01, -0.005, 0.03], [3.0, 0, 0, 0, 0, 0.02]])


def effects(poses):
    yaw, pitch, roll = Rotation.from_rotvec(poses[:, 3:]).as_euler("ZYX").T
    x, y, z = poses[:, :3].T
    return {
        "extrinsic_rotation": {"roll_rad": roll, "pitch_rad": pitch, "yaw_rad": yaw},
        "extrinsic_translation": {"x_m": x, "y_m": y, "z_m": z},
    }


def test_ranges_are_those_seen_from_there():
    streets = rooms(3)
    moved, _ = seen_from(scan_of(GRID, [seen(room) for room in streets]), effects(POSES))
    truth = np.stack([np.asarray(seen(r, p).range_m) for r, p in zip(streets, POSES, strict=True)])
    off = np.abs(moved.range_m - truth) / truth
    assert np.median(off) < 1e-4
    assert np.quantile(off, 0.9) < 0.03


def test_lifted_beams_see_what_lies_higher():
    streets = rooms(3)
    lift = {"beam_elevation_error": {"error_rad": np.full(24, 0.0087)}}
    moved, _ = seen_from(scan_of(GRID, [seen(room) for room in streets]), lift)
    truth = np.stack([np.asarray(seen(room, lift=0.0087).range_m) for room in streets])
    assert np.median(np.abs(moved.range_m - truth) / truth) < 1e-4


def test_a_sensor_that_stays_sees_what_it_saw():
    scan = scan_of(GRID, [seen(room) for room in rooms(2)])
    same, told = seen_from(scan, effects(np.zeros((2, 6))))
    np.testing.assert_allclose(same.range_m, scan.range_m, rtol=1e-6)
    np.testing.assert_allclose(same.intensity, scan.intensity, rtol=1e-5)
    np.testing.assert_array_equal(same.semantic, scan.semantic)
    assert told.all()


def test_beyond_the_image_and_where_surfaces_end_nothing_is_told():
    scan = scan_of(GRID, [seen(room) for room in rooms(2)])
    step = GRID.elevation_rad[0] - GRID.elevation_rad[1]
    lift = {"beam_elevation_error": {"error_rad": np.full(24, 4.2 * step)}}
    _, told = seen_from(scan, lift)
    # Two rows beyond the image its surfaces go on.
    assert not told[:, :2].any()
    assert told[:, 3:].mean() > 0.95
    # Where between two beams the ground ends is in no frame.
    down = -np.asarray(GRID.elevation_rad)[:, None] + np.zeros(180)
    flat = np.where(down > 0.02, 1.7 / np.sin(np.maximum(down, 0.02)), 0).astype(np.float32)
    ground = scan_of(GRID, [PolarImage(flat, (flat > 0).astype(np.float32), flat > 0)])
    _, told = seen_from(ground, {"beam_elevation_error": {"error_rad": np.full(24, 0.3 * step)}})
    first = int(np.argmax(down[:, 0] > 0.02))
    np.testing.assert_array_equal(told[0, :, 0], ~np.isin(np.arange(24), (first - 1, first)))


def test_what_moved_is_seen_by_neither_side_and_a_lost_ray_stays_lost():
    streets = rooms(2)
    scan = scan_of(GRID, [seen(room) for room in streets])
    measured = measured_of([seen(room) for room in streets])
    moving = np.zeros(scan.hit.shape, bool)
    moving[:, 4:12, 20:30] = True
    measured.range_m[moving] -= 2
    measured.valid[0, 15, 100] = False
    one, other = same_surfaces(scan, measured)
    assert not one.hit[moving].any()
    assert not other.valid[moving].any()
    assert one.hit[0, 15, 100]
    assert not other.valid[0, 15, 100]
    # A ray in a corner of the image has no two neighbours.
    assert (~one.hit[~moving]).sum() == 2 * 4


def test_the_share_of_lost_rays_is_that_of_all():
    scan = scan_of(GRID, [seen(room) for room in rooms(6)])
    measured = measured_of([seen(room) for room in rooms(6)])
    lost = np.random.default_rng(0).random(scan.hit.shape) < 0.1
    measured.range_m[:, 4:12, 20:60] -= 2
    measured.valid[lost] = False
    one, other = same_surfaces(scan, measured)
    kept = np.asarray(one.hit)
    share = 1 - np.asarray(other.valid)[kept].mean()
    assert abs(share - 0.1) < 3 * np.sqrt(0.09 / kept.sum())
