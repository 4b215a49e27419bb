from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.data.kitti_files import object_rect_from_velo, read_labels
from jaxsim.frame import Boxes
from jaxsim.geometry.boxes import (
    box_corners,
    camera_boxes,
    corners_of,
    iou_2d,
    iou_3d,
    iou_bev,
    lidar_boxes,
    nms_bev,
    pair_overlap,
    points_in_boxes,
    wrapped_heading,
)
from tests.geometry.kitti_scans import OBJECT, points


def some_boxes(rng, n, spread=4.0):
    return np.concatenate(
        [
            rng.uniform(-spread, spread, (n, 2)),
            rng.uniform(-2, 2, (n, 1)),
            rng.uniform(0.3, 6, (n, 3)),
            rng.uniform(-10, 10, (n, 1)),
        ],
        axis=1,
    ).astype(np.float32)


def awkward_pairs(rng, n):
    """Pairs that share edges, corners or directions, are thin, tiny or nearly equal, and at 70 m."""
    a, b = some_boxes(rng, n), some_boxes(rng, n)
    case = np.arange(n) % 8
    turned = case < 4
    b[turned] = a[turned]
    b[case == 0, :2] += rng.normal(0, 1e-6, (np.sum(case == 0), 2))
    b[case == 1, 6] += np.pi / 2 * rng.integers(-3, 4, np.sum(case == 1))
    b[case == 2, 6] += rng.normal(0, 1e-6, np.sum(case == 2))
    ahead = np.stack([np.cos(a[:, 6]), np.sin(a[:, 6])], axis=1)
    b[case == 3, :2] += (a[:, 3:4] * ahead)[case == 3]
    a[case == 4, 4] = 10 ** rng.uniform(-4, -2, np.sum(case == 4))
    corner = np.asarray(box_corners(a))[:, 0, :2] - np.asarray(box_corners(b))[:, 2, :2]
    b[case == 5, :2] += corner[case == 5]
    a[case == 6, 3:5] *= 0.01
    far = rng.uniform(-70, 70, (n, 2)).astype(np.float32)
    a[:, :2] += far
    b[:, :2] += far
    return a, b


def shapely():
    return pytest.importorskip("shapely", reason="shapely (the test extra) clips the polygons to compare with")


def polygons(boxes):
    """Outlines from above in float64, by the matrix and not by the code under test."""
    boxes = boxes.astype(np.float64)
    local = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])[None] * boxes[:, None, 3:5]
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    return shapely().polygons(local @ turn.swapaxes(-1, -2) + boxes[:, None, :2])


def overlaps(a, b):
    shared = shapely().area(shapely().intersection(polygons(a), polygons(b)))
    a, b = a.astype(np.float64), b.astype(np.float64)
    top = np.minimum(a[:, 2] + a[:, 5] / 2, b[:, 2] + b[:, 5] / 2)
    bottom = np.maximum(a[:, 2] - a[:, 5] / 2, b[:, 2] - b[:, 5] / 2)
    area_a, area_b = a[:, 3] * a[:, 4], b[:, 3] * b[:, 4]
    volume = shared * np.maximum(top - bottom, 0)
    return shared / (area_a + area_b - shared), volume / (area_a * a[:, 5] + area_b * b[:, 5] - volume)


def test_corners_on_the_host_are_those_of_the_kernel():
    boxes = np.random.default_rng(0).uniform(1, 4, (9, 7)).astype(np.float32)
    np.testing.assert_allclose(corners_of(boxes), box_corners(boxes), atol=1e-5)


def test_overlaps_are_the_golden_ones(golden):
    pairs = np.load(golden / "rotated_iou" / "pairs.npz")
    bev, volume = pair_overlap(pairs["boxes_a"], pairs["boxes_b"])
    for case, name in enumerate(pairs["case_names"]):
        rows = pairs["case"] == case
        assert np.asarray(bev)[rows] == pytest.approx(pairs["iou_bev_f64"][rows], abs=2e-6), name
        assert np.asarray(volume)[rows] == pytest.approx(pairs["iou_3d_f64"][rows], abs=2e-6), name
    same = pairs["case_names"].tolist().index("same")
    assert (np.asarray(bev)[pairs["case"] == same] == 1).all()


@pytest.mark.parametrize("count", [6000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_overlaps_are_those_of_shapely(count):
    rng = np.random.default_rng(count)
    worst = 0.0
    for _ in range(max(count // 20000, 1)):
        n = min(count, 20000) // 2
        plain = some_boxes(rng, n), some_boxes(rng, n)
        for a, b in (plain, awkward_pairs(rng, n)):
            for ours, theirs in zip(pair_overlap(a, b), overlaps(a, b), strict=True):
                # Of two slivers a micrometre is much: compare where float32 at 70 m can tell.
                worst = max(worst, float(np.abs(np.asarray(ours) - theirs).max()))
    print(f"{count} pairs, from above and in space: differ by {worst:.1e} at most")  # docs/metrics.md; pytest -rP
    assert worst < 1e-4


def test_identical_boxes_overlap_wholly_and_touching_ones_not_at_all():
    boxes = some_boxes(np.random.default_rng(1), 500, spread=80.0)
    assert (np.asarray(pair_overlap(boxes, boxes)) == 1).all()
    side = np.array([[3, 4, 0, 2, 2, 2, 0], [3, 4, 0, 4, 2, 2, np.pi / 2]], np.float32)
    beside = side + np.array([2, 0, 0, 0, 0, 0, 0], np.float32)
    above = side + np.array([0, 0, 2, 0, 0, 0, 0], np.float32)
    assert np.asarray(pair_overlap(side, beside)) == pytest.approx(0, abs=1e-7)
    bev, volume = pair_overlap(side, above)
    assert (np.asarray(bev) == 1).all()
    assert (np.asarray(volume) == 0).all()


def test_a_box_without_extent_overlaps_nothing():
    flat = np.array([[0, 0, 0, 4, 0, 1, 0.3], [0, 0, 0, -1, 2, 1, 0], [0, 0, 0, 0, 0, 0, 0]], np.float32)
    assert (np.asarray(pair_overlap(flat, flat)) == 0).all()


def test_every_box_meets_every_other_in_each_sample_of_a_batch():
    rng = np.random.default_rng(2)
    a, b = some_boxes(rng, 6).reshape(2, 3, 7), some_boxes(rng, 10).reshape(2, 5, 7)
    bev, volume = iou_bev(a, b), iou_3d(a, b)
    assert bev.shape == volume.shape == (2, 3, 5)
    for k, i, j in np.ndindex(2, 3, 5):
        pair = pair_overlap(a[k, i], b[k, j])
        assert float(bev[k, i, j]) == pytest.approx(float(pair[0]), abs=1e-6)
        assert float(volume[k, i, j]) == pytest.approx(float(pair[1]), abs=1e-6)


def test_rectangles_overlap_by_width_and_height_without_a_pixel_added():
    a = np.array([[0, 0, 10, 10], [0, 0, 0, 5]], np.float32)
    b = np.array([[5, 0, 15, 10], [10, 0, 20, 10], [2, 2, 4, 4]], np.float32)
    assert np.asarray(iou_2d(a, b)) == pytest.approx(np.array([[1 / 3, 0, 0.04], [0, 0, 0]]))


def test_corners_turn_with_the_heading():
    box = np.array([[10, 5, 1, 4, 2, 1.5, np.pi / 2]], np.float32)
    corners = np.asarray(box_corners(box))[0]
    assert corners[:4] == pytest.approx(np.array([[9, 7, 0.25], [11, 7, 0.25], [11, 3, 0.25], [9, 3, 0.25]]), abs=1e-5)
    assert corners[4:] == pytest.approx(corners[:4] + np.array([0, 0, 1.5]), abs=1e-5)


def test_points_inside_are_those_between_the_faces():
    rng = np.random.default_rng(3)
    boxes, xyz = some_boxes(rng, 20), rng.uniform(-6, 6, (400, 3)).astype(np.float32)
    inside = np.asarray(points_in_boxes(xyz, boxes))
    for j, box in enumerate(boxes.astype(float)):
        forward, left = [np.cos(box[6]), np.sin(box[6]), 0], [-np.sin(box[6]), np.cos(box[6]), 0]
        local = (xyz - box[:3]) @ np.array([forward, left, [0, 0, 1]]).T
        off = np.abs(local) - box[3:6] / 2
        clear = np.abs(off).min(axis=1) > 1e-5
        assert (inside[:, j] == (off <= 0).all(axis=1))[clear].all()
    nothing = np.array([[0, 0, 0, 0, 1, 1, 0]], np.float32)
    assert not points_in_boxes(np.zeros((1, 3), np.float32), nothing).any()


def greedy(boxes, score, threshold, keep, consider):
    order = [i for i in np.argsort(-score, kind="stable") if not np.isnan(score[i])][:consider]
    overlap = np.asarray(iou_bev(boxes, boxes))
    kept = []
    for i in order:
        if all(overlap[j, i] <= threshold for j in kept):
            kept.append(i)
    return kept[:keep]


@pytest.mark.parametrize(("threshold", "keep", "consider"), [(0.1, 50, None), (0.7, 20, 60), (0.0, 200, 90)])
def test_suppression_keeps_what_the_greedy_rule_keeps(threshold, keep, consider):
    rng = np.random.default_rng(4)
    boxes = some_boxes(rng, 240, spread=12.0).reshape(2, 120, 7)
    score = rng.integers(0, 40, (2, 120)).astype(np.float32)
    score[0, :5] = np.nan
    index, kept = nms_bev(boxes, score, threshold, keep=keep, consider=consider)
    assert index.shape == kept.shape == (2, keep)
    for k in range(2):
        expected = greedy(boxes[k], score[k], threshold, keep, consider)
        assert np.asarray(index)[k][np.asarray(kept)[k]].tolist() == expected
        assert not np.asarray(kept)[k, len(expected) :].any()


def test_suppression_leaves_out_padding_and_boxes_that_are_not_finite():
    boxes = some_boxes(np.random.default_rng(5), 4, spread=40.0)
    boxes[0, 6] = np.nan
    score = np.array([9, 1, 8, 3], np.float32)
    index, kept = nms_bev(boxes, score, 0.5, keep=4, valid=np.array([True, True, False, True]))
    assert (index.tolist(), kept.tolist()) == ([3, 1, 0, 0], [True, True, False, False])


def test_labels_go_to_the_lidar_and_back():
    rng = np.random.default_rng(6)
    n = 50
    cam_from_velo = np.array([[0, -1, 0, 0.1], [0, 0, -1, -0.1], [1, 0, 0, -0.3], [0, 0, 0, 1]], np.float32)
    labels = Boxes(
        centre_m=rng.uniform(-30, 30, (n, 3)).astype(np.float32),
        size_m=rng.uniform(1, 5, (n, 3)).astype(np.float32),
        yaw_rad=rng.uniform(-np.pi, np.pi, n).astype(np.float32),
        bbox_px=np.zeros((n, 4), np.float32),
        truncated=np.zeros(n, np.float32),
        occluded=np.zeros(n, np.int32),
        kind=("Car",) * n,
    )
    boxes = lidar_boxes(labels, cam_from_velo)
    centre, size, yaw = camera_boxes(boxes, cam_from_velo)
    assert centre == pytest.approx(labels.centre_m, abs=1e-6)
    assert (size.astype(np.float32) == labels.size_m).all()
    assert yaw == pytest.approx(labels.yaw_rad, abs=1e-7)
    # KITTI's own rule for corners, turned about y in the camera, is the same box.
    local = np.array([[0.5, 0, 0.5], [0.5, 0, -0.5], [-0.5, 0, -0.5], [-0.5, 0, 0.5]])[None]
    local = local * labels.size_m[:, None, [0, 2, 1]]
    cos, sin = np.cos(labels.yaw_rad)[:, None], np.sin(labels.yaw_rad)[:, None]
    x = cos * local[..., 0] + sin * local[..., 2] + labels.centre_m[:, None, 0]
    z = -sin * local[..., 0] + cos * local[..., 2] + labels.centre_m[:, None, 2]
    below = np.asarray(box_corners(boxes.astype(np.float32)))[:, :4]
    expected = np.stack([z + 0.3, -(x - 0.1)], axis=-1)
    distance = np.abs(below[:, :, None, :2] - expected[:, None]).max(-1).min(-1)
    assert distance.max() < 1e-4


def test_angles_that_need_no_turn_are_left_as_they_are():
    angle = np.array([-np.pi, -1e-30, 3.0, 3.5, 100.0])
    assert (wrapped_heading(angle)[:3] == angle[:3]).all()
    assert np.exp(1j * wrapped_heading(angle)) == pytest.approx(np.exp(1j * angle))
    assert (np.abs(wrapped_heading(angle)) <= np.pi).all()


def test_boxes_of_kitti_frames_hold_the_points_of_their_objects(samples):
    folder, counts = samples / "kitti_object" / "training", {}
    for scan in OBJECT:
        number = Path(scan).stem
        labels = read_labels(folder / "label_2" / f"{number}.txt")
        real = np.array([kind != "DontCare" for kind in labels.kind])
        boxes = lidar_boxes(labels, object_rect_from_velo(folder / "calib" / f"{number}.txt"))[real].astype(np.float32)
        xyz = points(samples, scan)[:, :3]
        for kind, box in zip(labels.kind, boxes, strict=False):
            inside = np.asarray(points_in_boxes(xyz, box[None]))[:, 0]
            # What stands above the road around the box is the object alone: the box cuts little of it off.
            standing = xyz[:, 2] > box[2] - 0.3 * box[5]
            wider = box + np.array([0, 0, 0, 0.8, 0.8, 0.4, 0], np.float32)
            around = np.asarray(points_in_boxes(xyz, wider[None]))[:, 0]
            counts[number, kind] = int(inside.sum())
            if kind != "Misc":  # a trailer: the car before it stands in the wider box
                assert (inside & standing).sum() >= 0.89 * (around & standing).sum(), (number, kind)
    assert counts == {
        ("000000", "Pedestrian"): 377,
        ("000001", "Truck"): 71,
        ("000001", "Car"): 9,
        ("000001", "Cyclist"): 18,
        ("000002", "Misc"): 1349,
        ("000002", "Car"): 67,
    }


def test_the_kernels_run_inside_jit_with_batches_of_their_own():
    boxes = jnp.asarray(some_boxes(np.random.default_rng(7), 12).reshape(3, 4, 7))
    together = jax.jit(jax.vmap(iou_3d))(boxes, boxes)
    assert np.asarray(together) == pytest.approx(np.asarray(iou_3d(boxes, boxes)), abs=1e-6)


@pytest.mark.parametrize("batch", [(), (3,)])
def test_of_no_boxes_none_is_kept(batch):
    index, kept = nms_bev(jnp.zeros((*batch, 0, 7)), jnp.zeros((*batch, 0)), 0.5, keep=4)
    assert index.shape == kept.shape == (*batch, 4)
    assert not kept.any()
