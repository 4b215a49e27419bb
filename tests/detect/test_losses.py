import hashlib
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import AnchorConfig, DetectorConfig, RoiConfig, VoxelConfig
from jaxsim.detect import losses
from jaxsim.detect.anchors import anchor_boxes, anchor_targets, decode_with_direction
from jaxsim.detect.roi_head import assign_rois, best_objects, sample_rois, seen_from_roi, targets_of
from jaxsim.geometry.boxes import box_corners

pytestmark = pytest.mark.usefixtures("quick_programs")

CONFIG = DetectorConfig()
TARGETS = jax.jit(partial(targets_of, config=RoiConfig()))


@pytest.fixture(scope="module")
def heads(published):
    return {name: jnp.asarray(array) for name, array in published("heads").items()}


def test_focal_loss_is_the_published_one(heads):
    loss = losses.focal(heads["focal_logits"], heads["focal_targets"]) * heads["focal_weights"][..., None]
    np.testing.assert_allclose(loss, heads["focal_out"], rtol=1e-5, atol=1e-6)


def test_smooth_l1_is_the_published_one_and_ignores_a_nan_target(heads):
    loss = losses.smooth_l1(heads["sl1_pred"], heads["sl1_target"]) * heads["sl1_weights"][..., None]
    np.testing.assert_allclose(loss, heads["sl1_out"], rtol=1e-5, atol=1e-6)
    assert np.isnan(heads["sl1_target"]).sum() == 1
    gradient = jax.jit(jax.grad(lambda p: losses.smooth_l1(p, heads["sl1_target"]).sum()))(heads["sl1_pred"])
    assert np.isfinite(gradient).all()


def test_direction_loss_is_the_published_one(heads):
    label = heads["dir_targets"].argmax(axis=-1)
    loss = losses.cross_entropy(heads["dir_logits"], label) * heads["dir_weights"]
    np.testing.assert_allclose(loss, heads["dir_out"], rtol=1e-5, atol=1e-6)


def test_corner_loss_is_the_published_one(heads):
    np.testing.assert_allclose(box_corners(heads["corner_pred"][:10]), heads["corners_pred"], atol=1e-4)
    loss = losses.corner_loss(heads["corner_pred"], heads["corner_gt"])
    np.testing.assert_allclose(loss, heads["corner_loss"], rtol=1e-4, atol=1e-5)


def test_corner_loss_of_a_box_with_itself_has_a_finite_gradient(heads):
    gradient = jax.jit(jax.grad(lambda b: losses.corner_loss(b, heads["corner_gt"]).sum()))(heads["corner_gt"])
    assert np.isfinite(gradient).all()


def test_first_stage_loss_is_the_published_one(heads, values):
    rng = np.random.RandomState(39)
    shape = (2, 200, 176)
    cls = rng.standard_normal((*shape, 2)).astype(np.float32) - 3
    box = (0.3 * rng.standard_normal((*shape, 14))).astype(np.float32)
    direction = rng.standard_normal((*shape, 4)).astype(np.float32)
    drawn = [hashlib.sha256(a.tobytes()).hexdigest()[:16] for a in (cls, box, direction)]
    assert drawn == values["heads"]["rpn_pred_sha"]
    anchors = jnp.asarray(anchor_boxes(AnchorConfig(), VoxelConfig()))
    gt = heads["assign_gt_boxes"]
    cls, box, direction = cls.reshape(2, -1), box.reshape(2, -1, 7), direction.reshape(2, -1, 2)

    @jax.jit
    def run(cls, box, direction):
        targets = anchor_targets(anchors, gt[..., :7], jnp.any(gt != 0, axis=-1), config=CONFIG.anchors)
        return losses.rpn_losses((cls, box, direction), targets, CONFIG)

    terms, expected = run(cls, box, direction), values["heads"]["rpn_loss"]
    for name in ("cls", "loc", "dir"):
        np.testing.assert_allclose(terms[f"rpn_{name}"], expected[f"rpn_loss_{name}"], rtol=1e-4)
    rows = heads["decoded_rows"]
    decoded = decode_with_direction(jnp.asarray(box[0][rows]), anchors[rows], jnp.asarray(direction[0][rows]))
    np.testing.assert_allclose(decoded, heads["decoded_boxes"], rtol=1e-5, atol=2e-5)


def test_each_proposal_finds_its_published_object(heads):
    rois, gt = heads["ptl_rois"][0], heads["ptl_gt_boxes"][0]
    overlap, mine = best_objects(rois, gt[:, :7], jnp.any(gt != 0, axis=-1))
    np.testing.assert_allclose(overlap, heads["ptl_max_iou"], atol=1e-5)
    apart = np.asarray(overlap) > 0
    np.testing.assert_array_equal(np.asarray(mine)[apart], np.asarray(heads["ptl_gt_assignment"])[apart])


def test_targets_of_the_published_draw_are_the_published_ones(heads):
    rois, gt, overlap = (heads[f"ptl_out_{name}"] for name in ("rois", "gt_of_rois_src", "gt_iou_of_rois"))
    targets = TARGETS(rois, gt[..., :7], overlap)
    np.testing.assert_allclose(targets.canonical, heads["ptl_out_gt_of_rois"][..., :7], atol=2e-5)
    np.testing.assert_allclose(targets.score, heads["ptl_out_rcnn_cls_labels"], atol=1e-6)
    np.testing.assert_array_equal(targets.foreground, heads["ptl_out_reg_valid_mask"] > 0)


def test_second_stage_loss_is_the_published_one(heads, values):
    rois, gt, overlap = (heads[f"ptl_out_{name}"] for name in ("rois", "gt_of_rois_src", "gt_iou_of_rois"))
    targets = TARGETS(rois, gt[..., :7], overlap)
    cls, box = heads["roi_cls_logits"].reshape(1, -1), heads["roi_reg_preds"][None]
    terms, expected = jax.jit(partial(losses.roi_losses, config=CONFIG))(cls, box, targets), values["heads"]["roi_loss"]
    np.testing.assert_allclose(terms["roi_cls"], expected["rcnn_loss_cls"], rtol=1e-4)
    np.testing.assert_allclose(terms["roi_reg"], expected["rcnn_loss_reg"], rtol=1e-4)
    np.testing.assert_allclose(terms["roi_corner"], expected["rcnn_loss_corner"], rtol=1e-4)
    np.testing.assert_allclose(losses.refined(box, rois)[0], heads["roi_decoded_boxes"], rtol=1e-5, atol=5e-5)


def test_second_stage_loss_without_foreground_has_a_finite_gradient(heads):
    nothing = np.zeros((1, 128, 7), np.float32)
    targets = TARGETS(nothing, nothing, np.zeros((1, 128), np.float32))

    def total(cls, box):
        return sum(losses.roi_losses(cls, box, targets, config=CONFIG).values())

    gradients = jax.jit(jax.grad(total, (0, 1)))(np.zeros((1, 128), np.float32), heads["roi_reg_preds"][None])
    assert all(np.isfinite(g).all() for g in gradients)
    assert (gradients[1] == 0).all()


def counts(overlap):
    return [int((overlap >= 0.55).sum()), int(((overlap < 0.55) & (overlap >= 0.1)).sum()), int((overlap < 0.1).sum())]


@pytest.mark.parametrize(
    ("kinds", "drawn"),
    [
        ((138, 98, 276), [64, 51, 13]),  # the published case
        ((10, 98, 276), [10, 94, 24]),
        ((0, 98, 276), [0, 98, 30]),
        ((70, 0, 442), [64, 0, 64]),
        ((70, 30, 412), [64, 30, 34]),
        ((300, 212, 0), [64, 64, 0]),
        ((512, 0, 0), [128, 0, 0]),
    ],
)
def test_proposals_are_drawn_in_the_published_numbers(kinds, drawn):
    rng = np.random.default_rng(0)
    overlap = np.concatenate([np.full(n, v) for n, v in zip(kinds, (0.8, 0.3, 0.0), strict=True)]).astype(np.float32)
    rng.shuffle(overlap)
    chosen = np.asarray(jax.jit(sample_rois, static_argnums=2)(jnp.asarray(overlap), jax.random.key(1), RoiConfig()))
    assert counts(overlap[chosen]) == drawn
    if kinds[0] >= 64 and sum(kinds[1:]):
        assert len(set(chosen[:64])) == 64  # foreground is not repeated


def test_a_scene_without_objects_gives_background_alone(heads):
    gt = np.zeros((1, 4, 7), np.float32)
    assign = jax.jit(partial(assign_rois, config=RoiConfig()))
    targets = assign(heads["ptl_rois"], gt, np.zeros((1, 4), bool), key=jax.random.key(0))
    assert not targets.foreground.any()
    assert (targets.score == 0).all()


def test_an_object_seen_from_itself_is_at_the_origin():
    box = jnp.array([[10.0, -3, -1, 4, 2, 1.5, 2.0]])
    seen = seen_from_roi(box.at[:, 6].add(np.pi), box)
    np.testing.assert_allclose(seen, [[0, 0, 0, 4, 2, 1.5, 0]], atol=1e-5)
