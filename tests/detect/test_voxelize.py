import hashlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import VoxelConfig
from jaxsim.detect.voxelize import voxelize

CONFIG = VoxelConfig()


def run(points, max_voxels, config=CONFIG, valid=None):
    valid = np.ones(len(points), bool) if valid is None else valid
    call = jax.jit(lambda p, v: voxelize(p, v, config, max_voxels=max_voxels))
    return jax.tree.map(np.asarray, call(points, valid))


def digest(array, dtype):
    return hashlib.sha256(np.ascontiguousarray(array.astype(dtype)).tobytes()).hexdigest()[:16]


def oracle(points, config, max_voxels):
    """Opens voxels point by point."""
    low, size = np.float32(config.range_m[:3]), np.float32(config.size_m)
    cells = np.round((np.array(config.range_m[3:]) - config.range_m[:3]) / config.size_m).astype(int)
    found, refused = {}, set()
    for point in points:
        place = np.floor((point[:3] - low) / size)
        if (place < 0).any() or (place >= cells).any():
            continue
        zyx = tuple(place[::-1].astype(int).tolist())
        if zyx not in found and len(found) == max_voxels:
            refused.add(zyx)
            continue
        members = found.setdefault(zyx, [])
        if len(members) < config.points_per_voxel:
            members.append(point)
    return found, len(refused)


@pytest.mark.parametrize(
    ("case", "cap"),
    [("fov_max40000", 40000), ("full_max40000", 40000), ("full_max16000", 16000), ("fov_max3000", 3000)],
)
def test_voxels_are_the_published_ones_in_the_published_order(scan, values, case, cap):
    points, seen = scan
    expected = values["voxelise"][case]
    voxels = run(points[seen] if case.startswith("fov") else points, cap)
    order = np.argsort(voxels.first, kind="stable")[: voxels.sites.valid.sum()]
    assert len(order) == expected["voxels"]
    assert voxels.points.sum() == expected["points_kept"]
    assert np.bincount(voxels.points[order], minlength=6).tolist() == expected["hist_num_points"]
    assert digest(voxels.sites.zyx[order], np.int32) == expected["coords_zyx_order_sha256_16_int32"]
    assert digest(voxels.points[order], np.int32) == expected["num_points_sha256_16_int32"]


def test_voxels_beyond_the_cap_are_counted(scan):
    points, seen = scan
    assert run(points[seen], 3000).dropped == 15463 - 3000
    assert run(points[seen], 16000).dropped == 0


def test_features_are_the_means_of_the_first_points(scan, published):
    points, seen = scan
    voxels = run(points[seen], 3000)
    rows = published("voxelise")["voxels_first300_fov_max3000"]
    order = np.argsort(voxels.first, kind="stable")[:300]
    np.testing.assert_allclose(
        voxels.features[order], rows.sum(axis=1) / voxels.points[order][:, None], rtol=0, atol=2e-6
    )


@pytest.mark.parametrize("cap", [7, 60])
def test_any_cloud_gives_what_point_by_point_opening_gives(cap):
    rng = np.random.default_rng(cap)
    config = VoxelConfig(range_m=(0, -1, -1, 2, 1, 1), size_m=(0.5, 0.4, 1.0), points_per_voxel=3)
    points = rng.uniform(-1.2, 2.2, (200, 5)).astype(np.float32)
    found, refused = oracle(points, config, cap)
    voxels = run(points, cap, config)
    assert voxels.sites.valid.sum() == len(found)
    assert voxels.dropped == refused
    for zyx, mean, count in zip(np.asarray(voxels.sites.zyx), voxels.features, voxels.points, strict=True):
        if count:
            np.testing.assert_allclose(mean, np.mean(found[tuple(zyx.tolist())], axis=0), atol=1e-6)
            assert count == len(found[tuple(zyx.tolist())])


def test_an_empty_cloud_has_no_voxel_and_no_nan():
    voxels = run(np.zeros((8, 4), np.float32), 5, valid=np.zeros(8, bool))
    assert not voxels.sites.valid.any()
    assert not voxels.points.any()
    assert (voxels.features == 0).all()


def test_gradients_go_to_the_points_that_entered_a_mean():
    config = VoxelConfig(range_m=(0, 0, 0, 2, 2, 2), size_m=(1, 1, 1), points_per_voxel=2)
    points = jnp.array([[0.5, 0.5, 0.5, 1], [0.6, 0.5, 0.5, 2], [0.7, 0.5, 0.5, 4], [5, 0, 0, 8]], jnp.float32)
    of_intensity = lambda p: voxelize(p, jnp.ones(4, bool), config, max_voxels=3).features[:, 3].sum()  # noqa: E731
    change = jax.jit(jax.grad(of_intensity))(points)
    np.testing.assert_allclose(change[:, 3], [0.5, 0.5, 0, 0])
