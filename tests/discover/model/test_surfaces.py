"""Which rays share a reflectance, and where the range image shows a plane."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.model.cast import (
    OBJECT_SD,
    PATCH_M,
    PATCH_SD,
    _numbered,
    bends,
    cast,
    edges,
    ray_index,
    surfaces_of,
    with_planes,
)
from jaxsim.geometry.polar import directions
from tests.discover.toy import device, toy

COLUMNS = np.broadcast_to(np.arange(0, 60, 2), (6, 30))
FRAMES = np.arange(6)


@pytest.fixture(scope="module")
def frames():
    return toy()


def noisy(scan, degrees: float, seed: int = 3):
    noise = np.random.default_rng(seed).normal(0, np.deg2rad(degrees), np.shape(scan.incidence_rad))
    return replace(scan, incidence_rad=np.clip(scan.incidence_rad + noise, 0, np.pi / 2).astype(np.float32))


def test_a_plane_shows_its_own_angle_where_the_simulators_normals_are_noisy(frames):
    scan, _ = frames
    (noised,) = device(noisy(scan, 3.0))
    better = np.asarray(with_planes(noised).incidence_rad)
    given = np.asarray(noised.incidence_rad)
    # The road is one plane; the last row and the rows beside the wall have no neighbour on one side.
    road = np.asarray(scan.semantic) == 7
    inner = road & np.roll(road, 1, axis=1) & np.roll(road, -1, axis=1)
    inner[:, [0, -1]] = False
    assert inner.sum() > 1000
    assert np.abs(better - scan.incidence_rad)[inner].max() < 2e-3
    assert np.abs(given - scan.incidence_rad)[inner].max() > 0.05


def test_what_is_no_plane_keeps_the_simulators_angle(frames):
    scan, _ = frames
    rough = np.random.default_rng(5).uniform(0.9, 1.1, np.shape(scan.range_m)).astype(np.float32)
    (bumpy,) = device(replace(scan, range_m=scan.range_m * rough))
    kept = np.asarray(with_planes(bumpy).incidence_rad) == np.asarray(bumpy.incidence_rad)
    assert kept.mean() > 0.95


def test_surfaces_are_objects_and_squares_of_one_class_and_strips_their_columns(frames):
    scan, _ = frames
    instance = np.zeros_like(scan.instance)
    instance[:, 2:5, 10:20] = 7
    scan = replace(scan, instance=instance, hit=np.random.default_rng(0).random(scan.hit.shape) > 0.1)
    index = ray_index(scan, FRAMES, COLUMNS)
    got = surfaces_of(scan, index)
    ray, numbers, strips = np.asarray(directions(scan.grid)), {}, {}
    for at in np.ndindex(got.strip.shape):
        f, r, c = (int(part[at]) for part in index)
        if not scan.hit[f, r, c]:
            assert got.strip[at] == 0
            continue
        square = tuple(np.floor(scan.range_m[f, r, c] * ray[r, c, :2] / PATCH_M).astype(int))
        key = (at[0], "object", instance[f, r, c]) if instance[f, r, c] else (at[0], scan.semantic[f, r, c], square)
        surface = got.surface[got.strip[at]]
        assert numbers.setdefault(key, surface) == surface > 0
        assert strips.setdefault((key, c), got.strip[at]) == got.strip[at] > 0
        sd = OBJECT_SD if instance[f, r, c] else PATCH_SD
        assert got.precision[surface] == pytest.approx(1 / sd**2, rel=1e-5)
    assert len(set(numbers.values())) == len(numbers)
    assert len(set(strips.values())) == len(strips)


@pytest.mark.parametrize("values", [5, 20_000])
def test_what_has_the_same_keys_is_numbered_as_rows_are_whatever_the_ids(values):
    """Of 20 000 values a key the numbers of all combinations do not fit into 64 bits."""
    ids = np.random.default_rng(0).integers(-(2**40), 2**40, values)
    keys = [np.random.default_rng(k).choice(ids, 30_000) for k in range(6)]
    # Some come twice.
    keys = [np.concatenate([key, key[:5000]]) for key in keys]
    _, first, number = np.unique(np.stack(keys), axis=1, return_index=True, return_inverse=True)
    ours = _numbered(*keys)
    np.testing.assert_array_equal(ours[0], first)
    np.testing.assert_array_equal(ours[1], number.ravel())


def test_a_plane_does_not_bend_and_a_step_does():
    # A wall straight ahead: 1 / range is the cosine of the angle, linear between neighbours for small steps.
    elevation = np.array([0.02, 0.0, -0.02], np.float32)
    wall = 10 / np.cos(np.array([0.01, 0.01, 0.02, 0.02]))
    one = np.ones((1,), np.float32)
    row = np.ones((1,), np.int32)
    side, stack = bends(10 * one, wall[None].astype(np.float32), row, elevation_rad=elevation)
    assert max(float(side[0]), float(stack[0])) < 1e-3
    stepped = np.array([[10.0, 14.0, 10.0, 10.0]], np.float32)
    assert float(bends(10 * one, stepped, row, elevation_rad=elevation)[0][0]) == pytest.approx(
        (1 - 10 / 14) / 2, rel=1e-4
    )


def test_edges_are_where_the_wall_meets_the_sky_and_not_amid_the_road(frames):
    scan, _ = frames
    (lost,) = device(replace(scan, hit=scan.hit & (np.arange(scan.hit.shape[1])[:, None] > 0)))
    rays = cast(lost, FRAMES, COLUMNS).rays
    edge = np.asarray(edges(rays, lost.grid.elevation_rad))
    assert edge[:, :, :2].all()
    road = np.asarray(rays.semantic) == 7
    inner = road & np.roll(road, 1, axis=2) & np.roll(road, -1, axis=2)
    inner[:, :, -1] = False
    assert edge[inner].mean() < 0.05
