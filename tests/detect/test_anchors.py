import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.config import AnchorConfig, VoxelConfig
from jaxsim.detect.anchors import (
    anchor_boxes,
    anchor_targets,
    decode,
    decode_with_direction,
    direction_bin,
    encode,
    nearest_bev,
)
from jaxsim.geometry.boxes import iou_2d

CONFIG, VOXELS = AnchorConfig(), VoxelConfig()
assign_all = jax.jit(anchor_targets, static_argnames="config")


def oracle(anchors, boxes, config):
    """Labels (1, 0, -1) and the object of each anchor, box by box in float64."""

    def rectangle(box):
        turn = abs(box[6] - np.floor(box[6] / np.pi + 0.5) * np.pi)
        half = np.array(box[3:5] if turn < np.pi / 4 else box[4:2:-1]) / 2
        return box[0] - half[0], box[1] - half[1], box[0] + half[0], box[1] + half[1]

    overlap = np.zeros((len(anchors), len(boxes)))
    for i, a in enumerate(map(rectangle, anchors)):
        for j, b in enumerate(map(rectangle, boxes)):
            width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
            if width > 0 and height > 0:
                shared = width * height
                sizes = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1])
                overlap[i, j] = shared / (sizes - shared)
    most, mine = overlap.max(axis=1), overlap.argmax(axis=1)
    label = np.where(most >= config.matched, 1, np.where(most < config.unmatched, 0, -1))
    for j in range(len(boxes)):
        if overlap[:, j].max() > 0:
            label[overlap[:, j] >= (1 - 1e-6) * overlap[:, j].max()] = 1  # boxes within two anchors are ties
    return label, mine


def test_anchors_are_the_published_ones(published, values):
    heads, anchors = published("heads"), anchor_boxes(CONFIG, VOXELS)
    assert anchors.shape == (70400, 7)
    np.testing.assert_allclose(anchors[:10], heads["anchors_first10"], atol=4e-6)
    np.testing.assert_allclose(anchors[-4:], heads["anchors_last4"], atol=4e-6)
    np.testing.assert_allclose(anchors[: 176 * 2 : 2, 0], heads["anchors_x"], atol=8e-6)
    np.testing.assert_allclose(anchors[:: 176 * 2, 1], heads["anchors_y"], atol=8e-6)
    np.testing.assert_allclose(anchors.astype(np.float64).sum(axis=0), values["heads"]["anchors"]["sum"], atol=0.2)


def test_coder_encodes_and_decodes_as_published(published):
    heads = published("heads")
    np.testing.assert_allclose(encode(heads["coder_boxes"], heads["coder_anchors"]), heads["coder_encoded"], atol=1e-5)
    decoded = decode(heads["coder_deltas"], heads["coder_anchors"])
    np.testing.assert_allclose(decoded, heads["coder_decoded"], rtol=1e-5, atol=1e-5)


def test_decoding_undoes_encoding():
    rng = np.random.default_rng(0)
    boxes, anchors = (jnp.asarray(rng.uniform(0.5, 4, (50, 7)), jnp.float32) for _ in range(2))
    np.testing.assert_allclose(decode(encode(boxes, anchors), anchors), boxes, rtol=1e-5, atol=1e-5)


def test_directions_are_the_published_bins(published):
    heads = published("heads")
    np.testing.assert_array_equal(direction_bin(jnp.asarray(heads["dir_target_heading"])), heads["dir_target_bin"])


def test_overlap_from_above_is_the_published_one(published):
    heads = published("heads")
    boxes, gt = (jnp.asarray(heads[name][:30]) for name in ("corner_pred", "corner_gt"))
    overlap = iou_2d(nearest_bev(boxes), nearest_bev(gt))
    np.testing.assert_allclose(overlap, heads["nearest_bev_iou"], atol=1e-5)


def test_every_anchor_has_its_published_label_and_target(published):
    heads, anchors = published("heads"), jnp.asarray(anchor_boxes(CONFIG, VOXELS))
    boxes = jnp.asarray(heads["assign_gt_boxes"])
    targets = assign_all(anchors, boxes[..., :7], jnp.any(boxes != 0, axis=-1), config=CONFIG)
    label = np.where(targets.positive, 1, np.where(targets.background, 0, -1))
    assert (label != heads["assign_labels_int8"]).sum() == 0
    at = heads["assign_pos_batch_anchor"]
    np.testing.assert_allclose(targets.deltas[at[:, 0], at[:, 1]], heads["assign_pos_reg_targets"], atol=2e-5)
    assert (np.asarray(targets.deltas)[~np.asarray(targets.positive)] == 0).all()


def test_labels_are_those_of_an_obvious_loop():
    rng = np.random.default_rng(1)
    config = AnchorConfig(matched=0.5, unmatched=0.3)
    anchors = np.float32(np.c_[rng.uniform(0, 12, (300, 2)), np.zeros(300), np.full((300, 3), 2.0), np.zeros(300)])
    anchors[:, 3] = 4
    boxes = np.float32(np.c_[rng.uniform(1, 11, (6, 2)), np.zeros(6), rng.uniform(1.5, 4, (6, 3)), np.arange(6)])
    label, mine = oracle(anchors, boxes, config)
    padded = jnp.zeros((1, 9, 7)).at[0, :6].set(boxes)
    targets = assign_all(jnp.asarray(anchors), padded, jnp.arange(9)[None] < 6, config=config)
    np.testing.assert_array_equal(np.where(targets.positive, 1, np.where(targets.background, 0, -1))[0], label)
    wanted = np.asarray(encode(boxes[mine], anchors))[label == 1]
    np.testing.assert_allclose(targets.deltas[0][label == 1], wanted, atol=1e-5)


def test_without_objects_every_anchor_is_background():
    anchors = jnp.asarray(anchor_boxes(CONFIG, VOXELS))
    targets = assign_all(anchors, jnp.zeros((1, 3, 7)), jnp.zeros((1, 3), bool), config=CONFIG)
    assert targets.background.all()
    assert not targets.positive.any()


def test_the_direction_bin_turns_a_heading_about():
    anchors = jnp.tile(jnp.array([[0, 0, 0, 4, 2, 1.5, 0]], jnp.float32), (2, 1))
    boxes = decode_with_direction(jnp.zeros((2, 7)), anchors, jnp.array([[1.0, 0], [0, 1.0]]))
    assert abs(np.sin(boxes[0, 6] - boxes[1, 6])) < 1e-5
    assert np.cos(boxes[0, 6] - boxes[1, 6]) < -0.99
    assert (direction_bin(boxes[:, 6]) == jnp.array([0, 1])).all()
