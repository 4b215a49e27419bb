"""The dense blocks against NumPy, in float64: batch norm, convolutions from above, heads, what becomes of scores."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import BackboneConfig, ProposalConfig, RoiConfig, VoxelConfig
from jaxsim.detect.backbones import AnchorHead, BevBackbone, SparseScale
from jaxsim.detect.layers import BatchNorm
from jaxsim.detect.network import VoxelRcnn, propose
from jaxsim.detect.roi_head import VoxelRoiHead, grid_points
from jaxsim.detect.sparse import Sites
from jaxsim.detect.steps import Network, join, split
from tests.detect.made_dense_blocks import block, connected, convolved, drawn, enlarged, normed, used
from tests.detect.tiny import EXPERIMENT

pytestmark = pytest.mark.usefixtures("quick_programs", "float64")
ROWS = np.random.default_rng(5).normal(1, 2, (2, 7, 3))
VALID = np.random.default_rng(6).random((2, 7)) < 0.6
SCALE, SHIFT = np.array([0.5, 1.5, -2.0]), np.array([0.1, -0.3, 0.7])
PLACES = ((0, 0), (0.4, 0), (20, 0), (1.0, 0), (40, 0), (60, 0))
"""The first and second share 3.6 of 4.4 m (0.82), the second and fourth 0.74, the first and fourth 0.6."""
SCORES = (0.5, 0.9, 0.2, 0.8, 0.1, 0.7)


@pytest.fixture
def float32(float64):
    """For what computes cells in single precision, as published."""
    with jax.enable_x64(False):
        yield


def trained_norm(rows, valid):
    """What batch norm gives in training, and the mean and unbiased variance that it remembers, channel by channel."""
    out, means, variances = np.empty_like(rows), [], []
    for c in range(rows.shape[-1]):
        own = rows[..., c][valid]
        mean, variance = own.mean(), ((own - own.mean()) ** 2).mean()
        out[..., c] = (rows[..., c] - mean) / np.sqrt(variance + 1e-5) * SCALE[c] + SHIFT[c]
        means.append(mean)
        variances.append(((own - mean) ** 2).sum() / (len(own) - 1))
    return out, np.array(means), np.array(variances)


@pytest.fixture
def norm():
    definition, network = split(BatchNorm(3))
    parameters = {"scale": jnp.asarray(SCALE), "shift": jnp.asarray(SHIFT)}
    statistics = {"mean": jnp.array([0.5, 0.0, -1.0]), "variance": jnp.array([1.0, 2.0, 3.0])}
    assert jax.tree.structure(network.parameters) == jax.tree.structure(parameters)
    return definition, Network(parameters, statistics)


@pytest.mark.parametrize("valid", [VALID, np.ones_like(VALID)])
def test_batch_norm_counts_the_valid_rows_and_remembers_the_unbiased_variance(norm, valid):
    definition, network = norm
    module = join(definition, network)
    out = module(jnp.asarray(ROWS), jnp.asarray(valid), train=True)
    wanted, mean, variance = trained_norm(ROWS, valid)
    np.testing.assert_allclose(out, wanted, rtol=1e-9)
    after, before = split(module)[1].statistics, network.statistics
    np.testing.assert_allclose(after["mean"], 0.9 * np.asarray(before["mean"]) + 0.1 * mean, rtol=1e-9)
    np.testing.assert_allclose(after["variance"], 0.9 * np.asarray(before["variance"]) + 0.1 * variance, rtol=1e-9)


def test_batch_norm_without_a_mask_counts_all_rows(norm):
    definition, network = norm
    out = used(definition, network, ROWS, train=True)
    np.testing.assert_allclose(out, trained_norm(ROWS, np.ones_like(VALID))[0], rtol=1e-9)


def test_batch_norm_without_a_valid_row_remembers_what_it_knew(norm):
    definition, network = norm
    module = join(definition, network)
    assert np.isfinite(module(jnp.asarray(ROWS), jnp.zeros((2, 7), bool), train=True)).all()
    jax.tree.map(np.testing.assert_array_equal, split(module)[1].statistics, network.statistics)


def test_batch_norm_in_use_takes_what_it_remembers(norm):
    definition, network = norm
    module = join(definition, network)
    out = module(jnp.asarray(ROWS), jnp.asarray(VALID), train=False)
    np.testing.assert_allclose(out, normed(ROWS, network.parameters, network.statistics, 1e-5), rtol=1e-9)
    jax.tree.map(np.testing.assert_array_equal, split(module)[1].statistics, network.statistics)


def test_the_gradient_of_batch_norm_goes_through_mean_and_variance_of_the_valid_rows(norm):
    definition, network = norm
    weight = np.random.default_rng(7).normal(size=ROWS.shape) * VALID[..., None]

    def loss(rows):
        return (jnp.asarray(weight) * join(definition, network)(rows, jnp.asarray(VALID), train=True)).sum()

    gradient, step = np.asarray(jax.jit(jax.grad(loss))(jnp.asarray(ROWS))), 1e-6
    for place in np.ndindex(ROWS.shape):
        up, down = ROWS.copy(), ROWS.copy()
        up[place] += step
        down[place] -= step
        slope = (weight * (trained_norm(up, VALID)[0] - trained_norm(down, VALID)[0])).sum() / (2 * step)
        np.testing.assert_allclose(gradient[place], slope, rtol=1e-5, atol=1e-7, err_msg=str(place))
    assert (gradient[~VALID] == 0).all()
    assert (gradient[VALID] != 0).all()


def test_the_map_is_each_blocks_output_enlarged_side_by_side():
    config = BackboneConfig(bev_layers=(1, 1), bev_widths=(4, 6), up_widths=(3, 5))
    definition, network = drawn(lambda: BevBackbone(config, 8, rngs=nnx.Rngs(0)))
    given = np.random.default_rng(3).normal(size=(1, 4, 6, 8))
    p, s = network.parameters, network.statistics
    x, outputs = given, []
    for k, stride in enumerate(config.bev_strides):
        for layer in range(2):
            own = stride if layer == 0 else 1
            x = block(x, p["blocks"][k][layer], s["blocks"][k][layer], lambda x, w, own=own: convolved(x, w, own))
        outputs.append(block(x, p["ups"][k], s["ups"][k], enlarged))
    wanted = np.concatenate(outputs, axis=-1)
    assert wanted.shape == (1, 4, 6, 8)
    np.testing.assert_allclose(used(definition, network, given, train=False), wanted, rtol=1e-8, atol=1e-10)


def test_anchors_follow_one_another_by_row_column_heading():
    """As those of OpenPCDet's permuted 1 x 1 convolutions: channels heading x (score, 7 of a box, 2 directions)."""
    definition, network = drawn(lambda: AnchorHead(4, 2, rngs=nnx.Rngs(0)))
    x = np.random.default_rng(4).normal(size=(2, 3, 5, 4))
    outputs = dict(zip(("cls", "box", "direction"), used(definition, network, x), strict=True))
    assert {name: array.shape for name, array in outputs.items()} == {
        "cls": (2, 30),
        "box": (2, 30, 7),
        "direction": (2, 30, 2),
    }
    for sample, y, column, heading in np.ndindex(2, 3, 5, 2):
        anchor = (y * 5 + column) * 2 + heading
        for name, values in outputs.items():
            width = 1 if name == "cls" else values.shape[-1]
            channels = slice(heading * width, (heading + 1) * width)
            layer = network.parameters[name]
            wanted = (
                x[sample, y, column] @ np.asarray(layer["kernel"])[:, channels] + np.asarray(layer["bias"])[channels]
            )
            np.testing.assert_allclose(values[sample, anchor], wanted if width > 1 else wanted[0], rtol=1e-9)


@pytest.mark.long
@pytest.mark.usefixtures("float32")
def test_the_second_stage_scores_and_encodes_what_it_pooled_of_each_proposal():
    """Grid points slowest, then the strides, then a stride's channels; the pools have a test of their own."""
    backbone = BackboneConfig(widths=(2, 3, 4, 5))
    config = RoiConfig(grid=2, radii_m=(2.0, 2.0, 4.0), width=3, samples=4, layers=(16, 16), dropout=0.0)
    voxels = VoxelConfig(range_m=(0, -3.2, -1.6, 6.4, 3.2, 1.6), size_m=(0.2, 0.2, 0.2))
    definition, network = drawn(lambda: VoxelRoiHead(config, backbone, rngs=nnx.Rngs(0)), np.float32)
    rng, scales = np.random.default_rng(10), []
    for channels, stride, count in ((3, 2, 400), (4, 4, 100), (5, 8, 16)):
        shape = (16 // stride, 32 // stride, 32 // stride)
        keys = np.stack([np.sort(rng.choice(int(np.prod(shape)), count, replace=False)) for _ in range(2)])
        features = rng.normal(0, 3, (2, count, channels)).astype(np.float32)
        scales.append(SparseScale(Sites(jnp.asarray(keys, jnp.int32), shape), jnp.asarray(features), stride))
    middle, size, heading = (
        rng.uniform([1, -2, -1], [5, 2, 1], (2, 5, 3)),
        np.full((2, 5, 3), 2.0),
        rng.normal(size=(2, 5, 1)),
    )
    rois = jnp.asarray(np.concatenate([middle, size, heading], -1).astype(np.float32))
    head = join(definition, network)
    cls, box = head(scales, rois, voxels, key=None)
    assert (cls.shape, box.shape) == ((2, 5), (2, 5, 7))

    points = grid_points(rois, 2).reshape(2, -1, 3)
    pooled = [
        np.asarray(pool(scale, points, radius_m=radius, voxels=voxels, config=config, train=False)).reshape(2, 5, 8, 3)
        for pool, scale, radius in zip(head.pools, scales, config.radii_m, strict=True)
    ]
    p, s = network.parameters, network.statistics
    rows = np.zeros((2, 5, 8 * 9))
    for point in range(8):
        for k in range(3):
            rows[..., point * 9 + k * 3 : point * 9 + k * 3 + 3] = pooled[k][:, :, point]
    assert (rows != 0).mean() > 0.2
    shared = connected(rows, p["shared"], s["shared"])
    for name, of, values in (("cls", "of_cls", cls[..., None]), ("box", "of_box", box)):
        wanted = connected(shared, p[of], s[of]) @ np.asarray(p[name]["kernel"]) + np.asarray(p[name]["bias"])
        spread = np.ptp(wanted, axis=(0, 1)).min()  # proposals differ by far more than rounding
        assert spread > 0.01
        np.testing.assert_allclose(values, wanted, rtol=0, atol=1e-3 * spread)


def cars(*places):
    """Boxes of 4 x 2 m along x."""
    return np.array([[x, y, 0.0, 4.0, 2.0, 1.5, 0.0] for x, y in places])


def test_proposals_are_the_best_boxes_that_do_not_overlap():
    config = ProposalConfig(before=6, overlap=0.65, after=5)
    boxes, score = cars(*PLACES), np.array(SCORES)
    found, taken = map(np.asarray, propose(jnp.asarray(score)[None], jnp.asarray(boxes)[None], config))
    # 1 takes 0 and 3 away.
    np.testing.assert_array_equal(taken[0], [True, True, True, True, False])
    np.testing.assert_allclose(found[0, :4], boxes[[1, 5, 2, 4]])
    assert (found[0, 4] == 0).all()


@pytest.mark.parametrize(
    ("config", "wanted"),
    [
        (ProposalConfig(before=3, overlap=0.65, after=5), [1, 5]),  # 3 was looked at, and fell
        (ProposalConfig(before=6, overlap=0.65, after=2), [1, 5]),
        (ProposalConfig(before=6, overlap=0.78, after=9), [1, 3, 5, 2, 4]),
    ],
)
def test_proposals_are_limited_before_and_after(config, wanted):
    boxes = cars(*PLACES)
    found, taken = map(np.asarray, propose(jnp.asarray(SCORES)[None], jnp.asarray(boxes)[None], config))
    assert taken.sum() == len(wanted)
    np.testing.assert_allclose(found[taken], boxes[wanted])


def test_detections_are_chosen_by_the_second_stages_score_and_no_filler_is_one():
    """The first stage prefers box 1, the second box 3 beside it; box 4 is below the least score; places are left."""
    boxes = cars(*PLACES)
    second = {0.0: 0.95, 0.4: 0.6, 20.0: 0.7, 1.0: 0.9, 40.0: 0.29, 60.0: 0.5}
    config = replace(
        EXPERIMENT.detector,
        score=0.3,
        proposals=ProposalConfig(before=6, overlap=0.78, after=8),
        final=ProposalConfig(before=8, overlap=0.1, after=6),
    )

    def roi(scales, rois, voxels, *, key):
        score = [[second.get(round(float(x), 6), 0.99) if size else 0.99 for x, size in rois[0][:, [0, 3]]]]
        logit = np.log(np.array(score) / (1 - np.array(score)))
        return jnp.asarray(logit), jnp.zeros_like(rois)

    def first_stage(points, valid, *, train):
        assert not train
        logits = jnp.log(jnp.asarray(SCORES))[None]
        return [], (logits, None, None), jnp.asarray(boxes)[None], {"voxels": jnp.array([3])}

    detector = SimpleNamespace(config=config, voxels=EXPERIMENT.voxels, first_stage=first_stage, roi=roi)
    found, dropped = VoxelRcnn.detect(detector, jnp.zeros((1, 4, 4)), jnp.ones((1, 4), bool))
    assert found.valid.sum() == 3
    valid = np.asarray(found.valid)
    # Box 0 is no proposal: box 1 took it away; fillers have score 0.99 and are none.
    np.testing.assert_allclose(np.asarray(found.boxes)[valid], boxes[[3, 2, 5]], atol=1e-9)
    np.testing.assert_allclose(np.asarray(found.score)[valid], [0.9, 0.7, 0.5])
    assert int(dropped["voxels"][0]) == 3
