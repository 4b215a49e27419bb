"""The sparse backbone on scan 000001 with the published program's drawn weights, stage by stage."""

import hashlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import BackboneConfig, DetectorConfig, VoxelConfig
from jaxsim.detect.backbones import BevBackbone, VoxelBackBone8x, capacities, height_compression
from jaxsim.detect.published import SPARSE_LAYOUTS, tensors
from jaxsim.detect.sparse import Sites
from jaxsim.detect.steps import join, split
from jaxsim.detect.voxelize import voxelize

CONFIG = VoxelConfig()


def drawn(weights):
    """The golden weights by the rule of README_geometry.md."""
    rng, arrays = np.random.RandomState(31), {}
    for name, about in weights.items():
        shape = tuple(about["shape"])
        if name.endswith("running_mean"):
            x = rng.standard_normal(shape) * 0.05
        elif name.endswith("running_var"):
            x = rng.uniform(0.5, 1.5, shape)
        elif name.endswith("bias"):
            x = rng.standard_normal(shape) * 0.1
        elif len(shape) == 1:
            x = rng.uniform(0.7, 1.3, shape)
        else:
            x = rng.standard_normal(shape) * np.sqrt(2 / np.prod(shape[1:])) * 1.3
        arrays[name] = x.astype(np.float32)
        assert hashlib.sha256(arrays[name].tobytes()).hexdigest()[:16] == about["sha256_16"], name
    return arrays


@pytest.fixture(scope="module")
def stages(scan, values):
    """Every stage's sites and features on the scan's points that the camera sees."""
    points, seen = scan
    arrays = drawn(values["backbone"]["weights"])
    make = lambda: VoxelBackBone8x(BackboneConfig(), 4, rngs=nnx.Rngs(0))  # noqa: E731
    definition = nnx.graphdef(nnx.eval_shape(make))
    network = jax.eval_shape(lambda: split(make())[1])
    for tensor in tensors(DetectorConfig()):
        if tensor.name.startswith("backbone_3d."):
            array = arrays[tensor.name.removeprefix("backbone_3d.")]
            tree = network.statistics if tensor.path[-1] in ("mean", "variance") else network.parameters
            for step in tensor.path[1:-1]:
                tree = tree[step]
            array = array.transpose(SPARSE_LAYOUTS["spconv 2"]) if tensor.layout == "sparse" else array
            assert tree[tensor.path[-1]].shape == array.shape
            tree[tensor.path[-1]] = jnp.asarray(array)

    @jax.jit
    def run(network, points):
        voxels = jax.vmap(lambda p: voxelize(p, jnp.ones(len(p), bool), CONFIG, max_voxels=16000))(points)
        scales, bev, dropped = join(definition, network)(
            voxels.sites, voxels.features, capacities(CONFIG, 16000), train=False
        )
        return voxels, scales, bev, dropped

    return run(network, jnp.asarray(points[seen])[None])


STAGES = ("x_conv2", "x_conv3", "x_conv4")


@pytest.mark.parametrize("stage", ["voxels_mean", *STAGES])
def test_a_stage_has_the_published_sites_and_features(stages, published, values, stage):
    voxels, scales, _, dropped = stages
    vectors, about = published("backbone"), values["backbone"][stage]
    sites, features = (voxels.sites, voxels.features) if stage == "voxels_mean" else (
        scales[STAGES.index(stage)].sites,
        scales[STAGES.index(stage)].features,
    )  # fmt: skip
    used = np.asarray(sites.valid[0])
    coords = np.asarray(sites.zyx[0])[used].astype(np.int32)
    coords = np.column_stack([np.zeros(len(coords), np.int32), coords])
    assert len(coords) == about["n"]
    assert (
        hashlib.sha256(np.ascontiguousarray(coords).tobytes()).hexdigest()[:16]
        == about["coords_sorted_sha256_16_int32"]
    )
    rows = vectors[f"{stage}_sample_rows_sorted"]
    np.testing.assert_array_equal(coords[rows], vectors[f"{stage}_sample_coords_bzyx"])
    features = np.asarray(features[0])[used]
    atol = 1e-4 * about["feature_absmax"]
    np.testing.assert_allclose(features[rows], vectors[f"{stage}_sample_features"], rtol=0, atol=atol)
    np.testing.assert_allclose(
        features.mean(axis=0, dtype=np.float64), vectors[f"{stage}_channel_mean_f64"], rtol=0, atol=atol
    )
    assert not any(int(count[0]) for count in dropped.values())


def test_the_map_from_above_is_the_published_one(stages, published, values):
    _, _, bev, _ = stages
    vectors, about = published("backbone"), values["backbone"]["bev"]
    bev = np.asarray(bev[0])
    assert bev.shape == (200, 176, 256)
    y, x = vectors["bev_sample_yx"].T
    atol = 1e-4 * values["backbone"]["encoded"]["feature_absmax"]
    np.testing.assert_allclose(bev[y, x], vectors["bev_sample_256"], rtol=0, atol=atol)
    assert (bev != 0).any(axis=-1).sum() == about["nonempty_cells"]
    np.testing.assert_allclose(bev.sum(dtype=np.float64), about["sum"], rtol=1e-4)


def test_height_compression_puts_planes_side_by_side():
    sites = Sites(jnp.array([[1, 5, 12, 99]], jnp.int32), (2, 2, 3))
    features = jnp.array([[[1.0, 2], [3, 4], [5, 6], [7, 8]]])
    bev = height_compression(sites, features)
    assert bev.shape == (1, 2, 3, 4)
    np.testing.assert_allclose(bev[0, 0, 1], [1, 0, 2, 0])
    np.testing.assert_allclose(bev[0, 1, 2], [3, 0, 4, 0])
    assert bev.sum() == 1 + 2 + 3 + 4  # keys beyond the grid are no site


def test_blocks_of_the_map_end_at_one_size():
    config = BackboneConfig(bev_layers=(1, 1), bev_widths=(4, 6), up_widths=(3, 5))
    run = lambda x: BevBackbone(config, 8, rngs=nnx.Rngs(0))(x, train=True)  # noqa: E731
    assert jax.eval_shape(run, jnp.ones((2, 12, 8, 8))).shape == (2, 12, 8, 8)
