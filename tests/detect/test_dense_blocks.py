"""The dense blocks against NumPy, in float64: batch norm, convolutions from above, heads, what becomes of scores."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import BackboneConfig, ProposalConfig, RoiConfig, VoxelConfig
from jaxsim.detect.backbones import AnchorHead, BevBackbone, Scale
from jaxsim.detect.layers import BatchNorm, ConvBlock, FullyConnected, Linear, UpBlock
from jaxsim.detect.network import VoxelRcnn, propose
from jaxsim.detect.roi_head import VoxelRoiHead, grid_points
from jaxsim.detect.sparse import Sites
from jaxsim.detect.state import Network, join, split
from tests.detect.tiny import EXPERIMENT

pytestmark = pytest.mark.usefixtures("quick_compile", "float64")


@pytest.fixture
def float64():
    with jax.enable_x64(True):
        yield


@pytest.fixture
def float32(float64):
    """For what computes cells in single precision, as published."""
    with jax.enable_x64(False):
        yield


def drawn(make, dtype=np.float64):
    """Definition and values of a module, all of them drawn at random; variances are positive."""
    with jax.enable_x64(False):
        definition, network = split(make())
    rng = np.random.default_rng(0)

    def draw(path, leaf):
        positive = "variance" in jax.tree_util.keystr(path)
        values = rng.uniform(0.5, 2, leaf.shape) if positive else rng.normal(0, 0.6, leaf.shape)
        return jnp.asarray(values.astype(dtype))

    return definition, jax.tree_util.tree_map_with_path(draw, network)


def used(definition, network, *inputs, **settings):
    """The module's output in use."""
    return jax.tree.map(np.asarray, join(definition, network)(*map(jnp.asarray, inputs), **settings))


def normed(x, parameters, statistics, eps):
    """Batch norm in use."""
    scale, shift = (np.asarray(parameters[name]) for name in ("scale", "shift"))
    mean, variance = (np.asarray(statistics[name]) for name in ("mean", "variance"))
    return (x - mean) / np.sqrt(variance + eps) * scale + shift


def convolved(x, kernel, stride):
    """3 x 3, padded by 1, cell by cell."""
    b, h, w, _ = x.shape
    padded = np.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0)))
    out = np.zeros((b, (h - 1) // stride + 1, (w - 1) // stride + 1, kernel.shape[-1]))
    for row, column in np.ndindex(out.shape[1:3]):
        patch = padded[:, stride * row : stride * row + 3, stride * column : stride * column + 3]
        out[:, row, column] = np.tensordot(patch, kernel, 3)
    return out


def enlarged(x, kernel):
    """Transposed convolution whose kernel is as wide as its stride, cell by cell."""
    b, h, w, _ = x.shape
    stride = len(kernel)
    out = np.zeros((b, h * stride, w * stride, kernel.shape[-1]))
    for row, column, i, j in np.ndindex(h, w, stride, stride):
        out[:, row * stride + i, column * stride + j] += x[:, row, column] @ kernel[i, j]
    return out


def block(x, parameters, statistics, layer):
    """A convolution `layer` of x, batch norm in use, ReLU."""
    kernel = np.asarray(parameters["kernel"])
    return np.maximum(normed(layer(x, kernel), parameters["norm"], statistics["norm"], 1e-3), 0)


ROWS = np.random.default_rng(5).normal(1, 2, (2, 7, 3))
VALID = np.random.default_rng(6).random((2, 7)) < 0.6
SCALE, SHIFT = np.array([0.5, 1.5, -2.0]), np.array([0.1, -0.3, 0.7])


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


@pytest.mark.parametrize(("stride", "size"), [(1, (5, 6)), (2, (5, 6)), (2, (6, 7))])
def test_a_convolution_from_above_pads_both_sides(stride, size):
    x = np.random.default_rng(1).normal(size=(2, *size, 3))
    definition, network = drawn(lambda: ConvBlock(3, 4, stride=stride, rngs=nnx.Rngs(0)))
    wanted = block(x, network.parameters, network.statistics, lambda x, kernel: convolved(x, kernel, stride))
    assert (wanted > 0).any()
    np.testing.assert_allclose(used(definition, network, x, train=False), wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("stride", [1, 2, 3])
def test_a_transposed_convolution_makes_cells_of_each_cell(stride):
    x = np.random.default_rng(2).normal(size=(2, 3, 4, 3))
    definition, network = drawn(lambda: UpBlock(3, 5, stride=stride, rngs=nnx.Rngs(0)))
    wanted = block(x, network.parameters, network.statistics, enlarged)
    assert wanted.shape == (2, 3 * stride, 4 * stride, 5)
    np.testing.assert_allclose(used(definition, network, x, train=False), wanted, rtol=1e-9, atol=1e-12)


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


def connected(x, parameters, statistics):
    """Linear maps, batch norm in use, ReLU."""
    for layer, p, s in zip(
        parameters["layers"].values(), parameters["norms"].values(), statistics["norms"].values(), strict=True
    ):
        x = np.maximum(normed(x @ np.asarray(layer["kernel"]), p, s, 1e-5), 0)
    return x


def test_fully_connected_layers_are_linear_maps_with_batch_norm():
    definition, network = drawn(lambda: FullyConnected(5, (4, 3), 0.3, rngs=nnx.Rngs(0)))
    x = np.random.default_rng(8).normal(size=(2, 6, 5))
    wanted = connected(x, network.parameters, network.statistics)
    np.testing.assert_allclose(used(definition, network, x, key=None), wanted, rtol=1e-9, atol=1e-12)


def second_layers_input(definition, network, x, dropout, monkeypatch):
    """In training."""
    module, seen = join(definition, network), []
    module.dropout = dropout
    monkeypatch.setattr(Linear, "__call__", lambda self, x: (seen.append(np.asarray(x)), x @ self.kernel[...])[1])
    module(jnp.asarray(x), key=jax.random.key(1))
    return seen[1]


def test_dropout_lies_between_the_layers_and_makes_up_for_what_falls_out(monkeypatch):
    definition, network = split(FullyConnected(6, (16, 8), 0.3, rngs=nnx.Rngs(0)))
    x = np.random.default_rng(9).normal(size=(400, 6))
    dropped, whole = (second_layers_input(definition, network, x, share, monkeypatch) for share in (0.3, 0.0))
    open_, kept = whole > 0, dropped != 0  # ReLU's own zeros aside
    assert abs(1 - kept[open_].mean() - 0.3) < 0.03
    np.testing.assert_allclose(dropped[kept], whole[kept] / 0.7, rtol=1e-9)


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
        scales.append(Scale(Sites(jnp.asarray(keys, jnp.int32), shape), jnp.asarray(features), stride))
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


PLACES = ((0, 0), (0.4, 0), (20, 0), (1.0, 0), (40, 0), (60, 0))
"""The first and second share 3.6 of 4.4 m (0.82), the second and fourth 0.74, the first and fourth 0.6."""
SCORES = (0.5, 0.9, 0.2, 0.8, 0.1, 0.7)


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
