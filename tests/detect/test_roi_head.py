import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from jaxsim.config import RoiConfig, VoxelConfig
from jaxsim.detect.backbones import SparseScale
from jaxsim.detect.roi_head import VoxelPool, cell_of, grid_points, voxel_query
from jaxsim.detect.sparse import Sites, cells, key_of
from jaxsim.geometry.boxes import points_in_boxes

VOXELS = VoxelConfig(range_m=(0, -2, -1, 4, 2, 1), size_m=(0.1, 0.1, 0.2))
SHAPE = (6, 20, 20)  # at stride 2


def random_sites(seed, share, capacity):
    zyx = np.argwhere(np.random.default_rng(seed).random(SHAPE) < share)
    key = np.full(capacity, cells(SHAPE), np.int32)
    key[: len(zyx)] = np.asarray(key_of(jnp.asarray(zyx), SHAPE))
    return Sites(jnp.asarray(key), SHAPE), zyx


def oracle(zyx, point, radius, config):
    """The scan of the published kernel: every cell in reach, z slowest."""
    rows = {tuple(place): row for row, place in enumerate(zyx.tolist())}
    fine = np.floor((point - np.float32(VOXELS.range_m[:3])) / np.float32(VOXELS.size_m)).astype(int)
    centre = (fine // 2)[::-1]
    found = []
    reach = range(-config.reach, config.reach + 1)
    for dz in reach:
        for dy in reach:
            for dx in reach:
                place = tuple((centre + np.array([dz, dy, dx])).tolist())
                row = rows.get(place)
                if row is None or len(found) == config.samples:
                    continue
                xyz = (np.array(place[::-1]) + 0.5) * np.float32(VOXELS.size_m) * 2 + VOXELS.range_m[:3]
                if ((xyz - point) ** 2).sum() <= radius**2:
                    found.append(row)
    return found


def test_a_query_finds_the_first_voxels_of_the_published_scan():
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.5, -2.5, -1.3], [4.5, 2.5, 1.3], (120, 3)).astype(np.float32)
    for share, radius in ((0.03, 0.4), (0.4, 0.4), (0.03, 1.2), (0.4, 0.9)):
        sites, zyx = random_sites(1, share, 1200)
        config = RoiConfig(samples=6, reach=3)
        query = jax.jit(lambda s, p, r=radius, c=config: voxel_query(s, p, VOXELS, stride=2, radius_m=r, config=c))
        index, near = (np.asarray(a) for a in query(sites, jnp.asarray(points)))
        for point, found, any_near in zip(points, index, near, strict=True):
            wanted = oracle(zyx, point, radius, config)
            assert any_near == bool(wanted)
            if wanted:
                assert found.tolist() == wanted + [wanted[0]] * (6 - len(wanted))


def test_grid_points_lie_inside_their_proposal_x_slowest():
    rois = jnp.array([[2.0, 1, 0, 4, 2, 1.5, 0.7], [5.0, -3, 0.2, 3, 1, 1, -2.5]])
    points = grid_points(rois, 3)
    assert points.shape == (2, 27, 3)
    inside = jax.vmap(lambda p, b: points_in_boxes(p, b[None]))(points, rois)
    assert inside.all()
    straight = np.asarray(grid_points(jnp.array([[0, 0, 0, 6.0, 3, 1.5, 0]]), 3))[0]
    np.testing.assert_allclose(straight[0], [-2, -1, -0.5], atol=1e-6)
    np.testing.assert_allclose(straight[1], [-2, -1, 0], atol=1e-6)
    np.testing.assert_allclose(straight[9], [0, -1, -0.5], atol=1e-6)


def test_cells_of_points_below_the_range_are_negative():
    cell = cell_of(jnp.array([[-0.05, -2.15, -1.0], [0.35, 0.0, 0.0]]), VOXELS, 2)
    np.testing.assert_array_equal(cell, [[0, -1, -1], [2, 10, 1]])


def test_pooling_is_grouping_adding_and_the_maximum():
    """Against a loop over points and voxels; a point without voxels gets the offset path at offset 0."""
    config, radius = RoiConfig(samples=4, reach=2), 0.3
    sites, zyx = random_sites(2, 0.05, 200)
    rng = np.random.default_rng(3)
    features = np.zeros((200, 5), np.float32)
    features[: len(zyx)] = rng.standard_normal((len(zyx), 5))
    points = rng.uniform([0, -2, -1], [4, 2, 1], (40, 3)).astype(np.float32)
    pool = VoxelPool(5, 3, rngs=nnx.Rngs(0))
    pool.offset_norm.shift[...] = jnp.array([0.1, -0.2, 0.3])
    pool.features_norm.mean[...] = jnp.array([0.2, 0.1, -0.3])
    batched = jax.tree.map(lambda a: a[None], sites)
    scale = SparseScale(batched, jnp.asarray(features)[None], 2)
    run = nnx.jit(lambda pool, scale, xyz: pool(scale, xyz, radius_m=radius, voxels=VOXELS, config=config, train=False))
    out = np.asarray(run(pool, scale, jnp.asarray(points)[None]))[0]

    def norm(x, layer):
        of = {name: np.asarray(getattr(layer, name)[...]) for name in ("scale", "shift", "mean", "variance")}
        return (x - of["mean"]) / np.sqrt(of["variance"] + 1e-5) * of["scale"] + of["shift"]

    kernels = [np.asarray(layer.kernel[...]) for layer in (pool.of_features, pool.of_offset, pool.out)]
    empty = 0
    for point, got in zip(points, out, strict=True):
        found = oracle(zyx, point, radius, config)
        empty += not found
        rows = []
        for row in found:
            xyz = (zyx[row][::-1] + 0.5) * np.float32(VOXELS.size_m) * 2 + VOXELS.range_m[:3]
            rows.append(
                norm(features[row] @ kernels[0], pool.features_norm)
                + norm((xyz - point) @ kernels[1], pool.offset_norm)
            )
        rows = rows or [norm(np.zeros(3), pool.offset_norm)]
        pooled = np.maximum(rows, 0).max(axis=0)
        np.testing.assert_allclose(got, np.maximum(norm(pooled @ kernels[2], pool.out_norm), 0), atol=1e-5)
    assert 0 < empty < 40


def test_gradients_of_pooling_are_finite_differences():
    config = RoiConfig(samples=4, reach=2)
    sites, _ = random_sites(4, 0.1, 300)
    rng = np.random.default_rng(5)
    points = jnp.asarray(rng.uniform([0, -2, -1], [4, 2, 1], (1, 30, 3)), jnp.float32)
    weight = jnp.asarray(rng.standard_normal((1, 30, 3)), jnp.float32)
    definition, state = nnx.split(VoxelPool(2, 3, rngs=nnx.Rngs(0)))

    @jax.jit
    def total(features):
        scale = SparseScale(jax.tree.map(lambda a: a[None], sites), features, 2)
        pool = nnx.merge(definition, state)
        return (pool(scale, points, radius_m=0.4, voxels=VOXELS, config=config, train=False) * weight).sum()

    features = jnp.asarray(rng.standard_normal((1, 300, 2)), jnp.float32)
    direction = jnp.asarray(rng.standard_normal((1, 300, 2)), jnp.float32)
    step = 1e-2
    numeric = (total(features + step * direction) - total(features - step * direction)) / (2 * step)
    # Forward and backward compiled together, or one by one: a maximum must be found again in either.
    for gradient in (jax.jit(jax.grad(total)), jax.grad(total)):
        np.testing.assert_allclose((gradient(features) * direction).sum(), numeric, rtol=2e-2)
