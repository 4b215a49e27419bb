import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.geometry import (
    directions,
    full_grid,
    incidence,
    known_or_median,
    network_incidence,
    normals,
    preset,
    window_grid,
)

SPEC = preset("hdl64e")
GRID = window_grid(SPEC, 0.5, -0.4, columns=24, rows=(26, 44))
RAYS = np.asarray(directions(GRID), np.float64)
ORIGIN = np.stack([0 * GRID.origin_m, 0 * GRID.origin_m, GRID.origin_m], -1)[:, None].astype(np.float64)


def ranges_to_plane(normal, offset, rays=RAYS, origin=ORIGIN):
    """Distance along each ray to the plane normal . x = offset, from the beam's own origin."""
    return (offset - origin @ normal) / (rays @ normal)


@settings(max_examples=40, deadline=None)
@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(4, 40))
def test_a_plane_has_one_normal_and_its_angle(yaw, pitch, distance):
    normal = -np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    range_m = ranges_to_plane(normal, -distance)
    assert (range_m > 0).all()
    got, known = normals(range_m.astype(np.float32), np.ones(range_m.shape, bool), GRID)
    assert known.all()
    assert got == pytest.approx(np.broadcast_to(normal, got.shape), abs=5e-3)
    angle, known = incidence(range_m.astype(np.float32), np.ones(range_m.shape, bool), GRID)
    assert known.all()
    assert angle == pytest.approx(np.arccos(-RAYS @ normal), abs=5e-3)


def test_the_road_points_up():
    range_m = ranges_to_plane(np.array([0.0, 0, 1]), -1.73).astype(np.float32)
    got, known = normals(range_m, np.ones(range_m.shape, bool), GRID)
    assert known.all()
    assert got == pytest.approx(np.broadcast_to([0.0, 0, 1], got.shape), abs=2e-3)
    angle, _ = incidence(range_m, np.ones(range_m.shape, bool), GRID)
    assert angle == pytest.approx(np.broadcast_to(np.pi / 2 + GRID.elevation_rad[:, None], angle.shape), abs=2e-3)


def test_an_edge_between_walls_leaves_both_sides_alone():
    """A wall at 10 m before one at 20 m: the step between them belongs to neither."""
    near, far = (ranges_to_plane(np.array([-1.0, 0, 0]), -x) for x in (10.0, 20.0))
    range_m = np.where(np.arange(24) < 12, near, far).astype(np.float32)
    got, known = normals(range_m, np.ones(range_m.shape, bool), GRID)
    assert known.all()
    assert got == pytest.approx(np.broadcast_to([-1.0, 0, 0], got.shape), abs=0.02)


def test_a_cell_needs_a_neighbour_in_its_row_and_in_its_column():
    range_m = ranges_to_plane(np.array([-1.0, 0, 0]), -10.0).astype(np.float32)
    valid = np.zeros(range_m.shape, bool)
    valid[5, 5:8] = valid[6, 5] = valid[9, 9] = True
    range_m[~valid] = np.nan
    got, known = normals(range_m, valid, GRID)
    assert np.argwhere(known).tolist() == [[5, 5]]
    assert got[5, 5] == pytest.approx([-1, 0, 0], abs=5e-3)
    assert not np.asarray(got)[~np.asarray(known)].any()


def test_a_whole_turn_closes_on_itself_and_a_window_does_not():
    turn = full_grid(preset("vlp16"), 64)
    flat = np.full((16, 64), 10.0, np.float32)
    valid = np.zeros((16, 64), bool)
    valid[:, [0, -1]] = True
    assert normals(flat, valid, turn)[1].sum() == 32
    valid = np.zeros((18, 24), bool)
    valid[:, [0, -1]] = True
    assert not normals(np.full((18, 24), 10.0, np.float32), valid, GRID)[1].any()


def test_a_batch_is_its_frames():
    rng = np.random.default_rng(0)
    range_m = rng.uniform(5, 6, (2, 3, 18, 24)).astype(np.float32)
    valid = rng.uniform(size=range_m.shape) > 0.2
    angle, known = incidence(range_m, valid, GRID)
    for i in np.ndindex(2, 3):
        one = incidence(range_m[i], valid[i], GRID)
        assert angle[i] == pytest.approx(np.asarray(one[0]), abs=1e-5)
        assert np.array_equal(known[i], one[1])


def test_the_angle_has_a_finite_gradient_head_on():
    range_m = np.full((18, 24), 10.0, np.float32)
    valid = np.ones(range_m.shape, bool)
    slope = jax.grad(lambda r: incidence(r, valid, GRID)[0].sum())(range_m)
    assert np.isfinite(slope).all()


def test_head_on_is_nought():
    grid = window_grid(preset("vlp16"), 1e-3, -1e-3, columns=3)
    rays = np.asarray(directions(grid), np.float64)
    range_m = (10 / rays[..., 0]).astype(np.float32)
    angle, _ = incidence(range_m, np.ones(range_m.shape, bool), grid)
    assert angle[:, 1] == pytest.approx(np.abs(grid.elevation_rad), abs=2e-3)


def test_networks_are_given_a_right_angle_where_none_is_known():
    range_m = ranges_to_plane(np.array([-1.0, 0, 0]), -10.0).astype(np.float32)
    valid = np.ones(range_m.shape, bool)
    valid[3:6, 3:6] = False
    valid[4, 4] = True
    angle, known = incidence(range_m, valid, GRID)
    given = network_incidence(range_m, valid, GRID)
    assert not known[4, 4]
    assert (np.asarray(given)[~np.asarray(known)] == np.float32(np.pi / 2)).all()
    np.testing.assert_array_equal(np.asarray(given)[known], np.asarray(angle)[known])


def test_an_angle_that_cannot_be_told_is_the_common_one():
    angle = np.float32([[0.2, 0.4, 1.3, 9.0]])
    assert known_or_median(angle, np.array([[True, True, True, False]])).tolist() == [[*angle[0, :3], angle[0, 1]]]
    assert known_or_median(angle, np.zeros((1, 4), bool)).tolist() == [[0.0] * 4]
