"""The ray caster and the laws against cases worked out by hand."""

import numpy as np
import pytest

from benchmarks.blind.hidden import laws
from benchmarks.blind.hidden import world as w
from benchmarks.blind.hidden.frames import Grid, Moment, nominal, silhouette, steps
from benchmarks.blind.hidden.light import extrinsic_rotation, motion_distortion
from benchmarks.blind.hidden.world import World, box, cast, cylinder, ellipsoid, prism


def _world(*solids):
    return World(5.0, 8.0, 1e6, list(solids))


def _ray(azimuth_deg, elevation_deg):
    a, e = np.deg2rad([azimuth_deg, elevation_deg])
    return np.array([[np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]])


EYE = np.array([[0.0, 0.0, 1.8]])


def test_ground_range_is_height_over_sine():
    hits = cast(_world(), EYE, _ray(0, -10))
    assert hits.range_m[0] == pytest.approx(1.8 / np.sin(np.deg2rad(10)))
    assert hits.semantic[0] == w.ROAD
    np.testing.assert_allclose(hits.normal[0], [0, 0, 1])
    assert cast(_world(), EYE, _ray(90, -15)).semantic[0] == w.SIDEWALK
    assert cast(_world(), EYE, _ray(90, -5))[2][0] == w.TERRAIN
    assert np.isinf(cast(_world(), EYE, _ray(0, 1)).range_m[0])
    assert np.isinf(cast(_world(), EYE, _ray(0, -0.5), reach_m=120).range_m[0])


@pytest.mark.parametrize("azimuth", [-170, -90, 0, 30, 179.5])
def test_a_wall_square_to_the_ray_lies_at_its_distance(azimuth):
    a = np.deg2rad(azimuth)
    wall = box((20 * np.cos(a), 20 * np.sin(a)), (1.0, 6.0), 0, 5, a, w.WALL, 3)
    hits = cast(_world(wall), np.repeat(EYE, 3, 0), np.concatenate([_ray(azimuth + d, 0) for d in (-4, 0, 4)]))
    np.testing.assert_allclose(hits.range_m, 19.5 / np.cos(np.deg2rad([4, 0, 4])))
    np.testing.assert_allclose(hits.normal, np.repeat([[-np.cos(a), -np.sin(a), 0]], 3, 0), atol=1e-12)
    assert (hits.instance == 3).all()


def test_an_oblique_wall_shows_its_angle():
    wall = box((0, 10), (400.0, 1.0), 0, 30, 0, w.BUILDING, 1)
    hits = cast(_world(wall), EYE, _ray(30, 0))
    assert hits.range_m[0] == pytest.approx(9.5 / np.sin(np.deg2rad(30)))
    assert -(hits.normal[0] @ _ray(30, 0)[0]) == pytest.approx(np.sin(np.deg2rad(30)))


def test_poles_balls_and_slanted_screens():
    assert cast(_world(cylinder((10, 0), 0.1, 0, 3, w.POLE, 1)), EYE, _ray(0, 0)).range_m[0] == pytest.approx(9.9)
    assert np.isinf(cast(_world(cylinder((10, 0), 0.1, 0, 1.5, w.POLE, 1)), EYE, _ray(0, 0)).range_m[0])
    ball = ellipsoid(np.array([10.0, 0, 1.8]), np.array([2.0, 1, 1]), w.PERSON, 1)
    assert cast(_world(ball), EYE, _ray(0, 0)).range_m[0] == pytest.approx(8.0)
    ramp = prism(np.array([[0, 0], [4, 0], [4, 4.0]]), 4, (10, 0), 0, w.CAR, 1)
    hits = cast(_world(ramp), EYE, _ray(0, 0))
    assert hits.range_m[0] == pytest.approx(11.8)
    np.testing.assert_allclose(hits.normal[0], [-np.sqrt(0.5), 0, np.sqrt(0.5)], atol=1e-12)


def test_culling_by_azimuth_loses_no_hit():
    rng = np.random.default_rng(0)
    solids = [
        box(rng.uniform(-30, 30, 2) + 4, rng.uniform(1, 25, 2), 0, rng.uniform(1, 6), rng.uniform(-3, 3), 11, k)
        for k in range(12)
    ]
    solids = [s for s in solids if w._distance_to(s.footprint, np.zeros(2)) > 2]
    d = np.concatenate([_ray(a, e) for a in np.arange(-180, 180, 3.7) for e in (-12, -3, 1)])
    o = EYE + rng.uniform(-0.7, 0.7, (len(d), 3)) * [1, 1, 0]
    fast = cast(_world(*solids), o, d)
    slow = np.full(len(d), np.inf)
    for solid in solids:
        slow = np.minimum(slow, w._meet(solid, o, d)[0])
    ground, _ = w._ground(_world(), o, d)
    slow = np.minimum(slow, ground)
    np.testing.assert_allclose(fast.range_m, np.where(slow < 120, slow, np.inf))


def test_a_yaw_turns_every_ray_to_the_left():
    grid = Grid(np.array([0.1, 0.0]), np.array([0.0]))
    rays = nominal(grid)
    plan = extrinsic_rotation(0.01, np.random.default_rng(3), None)
    turn = plan.parameters
    assert np.linalg.norm(list(turn.values())) == pytest.approx(0.01)
    plan.rays[0](rays, grid, None)
    x, y, z = rays.direction[0, 1]
    assert y == pytest.approx(turn["yaw_rad"], abs=1e-4)
    assert z == pytest.approx(-turn["pitch_rad"], abs=1e-4)
    assert x == pytest.approx(1, abs=1e-4)


def test_motion_moves_the_first_column_back_and_the_last_ahead():
    grid = Grid(np.linspace(1, -1, 4), np.array([0.0]))
    rays = nominal(grid)
    motion_distortion(1.0, np.random.default_rng(0), None).rays[0](rays, grid, Moment(0, 0, 0, 0, 20.0, 0))
    np.testing.assert_allclose(rays.offset[0, :, 0], 2.0 * (np.array([0.5, 1.5, 2.5, 3.5]) / 4 - 0.5))


def test_silhouettes_are_steps_of_more_than_five_percent():
    r = np.array([[20.0, 20.5, 20.4, 30.0, np.inf, np.inf]])
    assert silhouette(r, full_turn=False).tolist() == [[False, False, True, True, True, False]]
    assert steps(r, full_turn=False)[1, 0, 2] == pytest.approx(9.6)


def test_rough_facets_are_flatter_than_lambert():
    theta = np.deg2rad([0.0, 30, 60, 75])
    smooth, rough = laws.oren_nayar_facets(0.02)(theta), laws.oren_nayar_facets(0.5)(theta)
    np.testing.assert_allclose(smooth, 1, atol=0.02)
    assert (np.diff(rough) > 0).all()
    assert 1.1 < rough[2] < 3


def test_a_slanted_surface_stretches_the_pulse_by_half_the_footprint():
    r, theta, width = np.array([20.0]), np.deg2rad([60.0]), 2e-3
    found = laws.stretched_pulse(r, theta, width)[0]
    assert found == pytest.approx(0.5 * 20 * width * np.tan(theta[0]), rel=0.12)
    assert laws.stretched_pulse(r, np.zeros(1), width)[0] == pytest.approx(0, abs=1e-4)


def test_fog_and_defocus_have_the_right_limits():
    assert laws.foggy_transmission(0.01)(np.array([50.0]))[0] == pytest.approx(np.exp(-1), rel=0.02)
    near, far = laws.defocus(4.0)(np.array([1.0, 30.0]))
    assert near < 0.08
    assert far == pytest.approx(1, abs=1e-6)


def test_least_squares_finds_the_rate_and_leaves_the_level_free():
    x = np.linspace(0, 5, 50)
    assert laws.fit(lambda t, a: a * t, [0.5], x, 2 * x + 7, True)[0] == pytest.approx(2)
