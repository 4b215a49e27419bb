"""Displaced rays against the scene itself, cast from where they truly start."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.effects import EFFECTS, all_rays
from jaxsim.effects.chain import apply_law
from jaxsim.effects.scan import slopes_of
from tests.effects.streets import cast, directions_of, fields_of, grid_of, road_and_walls
from tests.quick import quick_jit


def angles(grid):
    azimuth, elevation = np.meshgrid(grid.azimuth_rad.astype(float), grid.elevation_rad.astype(float))
    return azimuth, elevation


def rotation(roll, pitch, yaw):
    def about(i, j, angle):
        m = np.eye(3)
        m[i, i] = m[j, j] = np.cos(angle)
        m[i, j], m[j, i] = -np.sin(angle), np.sin(angle)
        return m

    return about(0, 1, yaw) @ about(2, 0, pitch) @ about(1, 2, roll)


def displaced(name, values, scan, rays=None):
    rays = jax.jit(all_rays)(scan) if rays is None else rays
    return compiled(name)(EFFECTS[name].values(values, scan.range_m.shape[1]), rays, scan=scan)


@cache
def compiled(name):
    return quick_jit(partial(apply_law, EFFECTS[name]))


def check(rays, truth, *, share=0.9, inside=None, median_m=2e-3):
    """Where the right surface was met the range is right, and it is met nearly everywhere."""
    range_m, semantic, _ = truth
    hit = np.isfinite(range_m) & np.asarray(rays.hit[0])
    same = hit & (np.asarray(rays.semantic[0]) == semantic)
    if inside is not None:
        hit, same = hit & inside, same & inside
    assert same.sum() > share * hit.sum()
    off = np.abs(np.asarray(rays.range_m[0]) - np.where(hit, range_m, 0))[same]
    assert np.median(off) < median_m
    assert np.quantile(off / range_m[same], 0.97) < 5e-3
    return off


@pytest.mark.parametrize("name", ["extrinsic_rotation", "extrinsic_translation", "beam_elevation_error",
                                  "beam_azimuth_error", "motion_distortion"])  # fmt: skip
@pytest.mark.parametrize("turn", [2 * np.pi, 1.9])
def test_no_displacement_changes_nothing(name, turn):
    scan = road_and_walls(grid_of(turn), speed=[10.0])
    before, after = all_rays(scan), displaced(name, {}, scan)
    for field, value in fields_of(before).items():
        np.testing.assert_allclose(
            np.asarray(getattr(after, field)), np.asarray(value), rtol=1e-6, atol=1e-6, err_msg=field
        )


@pytest.mark.parametrize("angles_rad", [(0.006, 0.0, 0.0), (0.0, 0.006, 0.0), (0.0, 0.0, 0.03), (0.01, -0.012, 0.02)])
def test_a_rotated_sensor_meets_what_a_rotated_ray_meets(angles_rad):
    grid = grid_of()
    rays = displaced("extrinsic_rotation", dict(zip(("roll_rad", "pitch_rad", "yaw_rad"), angles_rad, strict=True)),
                     road_and_walls(grid))  # fmt: skip
    check(rays, cast(directions_of(*angles(grid)) @ rotation(*angles_rad).T))


@pytest.mark.parametrize("shift_m", [(0.3, 0.0, 0.0), (0.0, -0.4, 0.0), (0.0, 0.0, 0.2), (-0.1, 0.2, -0.05)])
def test_a_displaced_sensor_reads_the_range_from_where_it_is(shift_m):
    grid = grid_of()
    rays = displaced(
        "extrinsic_translation", dict(zip(("x_m", "y_m", "z_m"), shift_m, strict=True)), road_and_walls(grid)
    )
    off = check(rays, cast(directions_of(*angles(grid)), shift_m))
    assert np.quantile(off, 0.9) < 0.01


def test_each_beam_s_elevation_error_moves_its_own_readings():
    grid = grid_of()
    error = np.random.default_rng(0).normal(0, 0.003, 24)
    azimuth, elevation = angles(grid)
    rays = displaced("beam_elevation_error", {"error_rad": error}, road_and_walls(grid))
    check(rays, cast(directions_of(azimuth, elevation + error[:, None])))


def test_each_beam_s_azimuth_error_moves_its_own_readings():
    grid = grid_of()
    error = np.random.default_rng(0).normal(0, 0.003, 24)
    azimuth, elevation = angles(grid)
    rays = displaced("beam_azimuth_error", {"error_rad": error}, road_and_walls(grid))
    check(rays, cast(directions_of(azimuth + error[:, None], elevation)))


def test_motion_moves_the_origin_by_speed_and_place_within_the_scan():
    grid = grid_of()
    scan = road_and_walls(grid, speed=[12.0])
    rays = displaced("motion_distortion", {"share": 1.0}, scan)
    azimuth, elevation = angles(grid)
    forward = 12.0 * 0.1 * ((np.arange(96) + 0.5) / 96 - 0.5)
    origin = np.zeros((*azimuth.shape, 3))
    origin[..., 0] = forward[None]
    check(rays, cast(directions_of(azimuth, elevation), origin))
    still = displaced("motion_distortion", {"share": 1.0}, road_and_walls(grid, speed=[0.0]))
    np.testing.assert_allclose(np.asarray(still.range_m), np.asarray(scan.range_m), rtol=1e-6)


def test_two_displacements_add_up():
    grid = grid_of()
    scan = road_and_walls(grid)
    rays = displaced("extrinsic_rotation", {"yaw_rad": 0.02, "pitch_rad": 0.004}, scan)
    rays = displaced("extrinsic_translation", {"x_m": 0.3, "y_m": 0.2}, scan, rays)
    check(rays, cast(directions_of(*angles(grid)) @ rotation(0, 0.004, 0.02).T, (0.3, 0.2, 0.0)))


def test_intensity_and_angle_follow_the_surface():
    grid = grid_of()
    pitch = 0.004
    rays = displaced("extrinsic_rotation", {"pitch_rad": pitch}, road_and_walls(grid))
    _, semantic, cosine = cast(directions_of(*angles(grid)) @ rotation(0, pitch, 0).T)
    same = np.asarray(rays.hit[0]) & (semantic == np.asarray(rays.semantic[0])) & (cosine > 0.03)
    off = np.asarray(rays.log_intensity[0])[same] - np.log(0.4 * cosine[same])
    assert np.quantile(np.abs(off), 0.95) < 0.01
    off = np.asarray(rays.incidence_rad[0])[same] - np.arccos(np.clip(cosine[same], 0, 1))
    assert np.quantile(np.abs(off), 0.95) < 0.01
    power = np.asarray(rays.log_intensity - 2 * jnp.log(jnp.maximum(rays.range_m, 0.1) / 10))
    np.testing.assert_allclose(np.asarray(rays.log_power), power, atol=1e-5)


def test_rays_that_leave_the_image_keep_their_own_surface():
    scan = road_and_walls(grid_of(0.8))
    rays = displaced("beam_elevation_error", {"error_rad": np.full(24, -0.3)}, scan)
    before = all_rays(scan)
    for field in ("range_m", "hit", "reading_m", "log_intensity"):
        np.testing.assert_array_equal(
            np.asarray(getattr(rays, field)[0, -4:]), np.asarray(getattr(before, field)[0, -4:])
        )


def test_the_derivative_is_that_of_the_true_scene():
    grid = grid_of()
    scan = road_and_walls(grid)
    effect = EFFECTS["extrinsic_rotation"]

    def ranges(pitch):
        return apply_law(effect, effect.values({}, 24) | {"pitch_rad": pitch}, all_rays(scan), scan=scan).reading_m[0]

    slope = np.asarray(quick_jit(jax.jacfwd(ranges))(jnp.float32(0.0)))
    step = 1e-5
    rays = directions_of(*angles(grid))
    ahead, behind = (cast(rays @ rotation(0, s, 0).T)[0] for s in (step, -step))
    both = np.isfinite(ahead) & np.isfinite(behind)
    true = (np.where(both, ahead, 0) - np.where(both, behind, 0)) / (2 * step)
    both &= np.abs(true) < 3000
    off = np.abs(slope - true)[both] / (5 + np.abs(true[both]))
    assert np.quantile(off, 0.95) < 0.02


def test_a_lone_pole_stays_at_its_range():
    scan = road_and_walls()
    range_m, hit = scan.range_m.at[0, :8, 40].set(6.0), scan.hit.at[0, :8, 40].set(True)
    scan = scan.replace(range_m=range_m, hit=hit, slopes=slopes_of(scan.grid, range_m[0], hit[0])[None])
    rays = displaced("extrinsic_rotation", {"yaw_rad": 0.02}, scan)
    assert np.allclose(np.asarray(rays.range_m[0, 2:6, 40]), 6.0, rtol=0.02)
    # The step between columns is 0.065 rad: a whole one brings the pole to its neighbour.
    step = float(scan.grid.azimuth_rad[40] - scan.grid.azimuth_rad[41])
    rays = displaced("extrinsic_rotation", {"yaw_rad": np.float32(-step * 0.75)}, scan)
    assert np.allclose(np.asarray(rays.range_m[0, 2:6, 39]), 6.0, rtol=0.02)
    assert (np.asarray(rays.range_m[0, 2:6, 40]) != 6.0).all()


def test_a_sensor_of_one_beam_is_displaced_too():
    """Turned by whole columns about its axis it reads what stood so many columns on."""
    whole = grid_of(2 * np.pi)
    scan = road_and_walls(replace(whole, elevation_rad=whole.elevation_rad[8:9], origin_m=whole.origin_m[8:9]))
    columns = scan.range_m.shape[-1]
    turned = dict.fromkeys(EFFECTS["extrinsic_rotation"].parameters, 0.0) | {"yaw_rad": 3 * 2 * np.pi / columns}
    read = np.asarray(displaced("extrinsic_rotation", turned, scan).range_m)[0, 0]
    either = [np.abs(read - np.roll(scan.range_m[0, 0], shift)) for shift in (3, -3)]
    assert min(np.median(off) for off in either) < 1e-3
    assert np.median(np.abs(read - scan.range_m[0, 0])) > 1e-2
