import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxsim.cloud.kitti_tree import (
    calibration_text,
    choose_boxes,
    label_lines,
    tree_files,
    within_reach,
    write_image_sets,
    write_kitti_frame,
)
from jaxsim.data import KittiObject
from jaxsim.data.kitti_files import object_rect_from_velo
from jaxsim.data.synthetic import kitti_camera
from jaxsim.frame import Boxes, CameraFrame, Cloud
from jaxsim.geometry.boxes import lidar_boxes
from jaxsim.metrics.detection import read_truth
from tests.cloud import openpcdet_rules as rules

SIZE = (38, 124)


def some_boxes(kinds=("Car", "Pedestrian", "Van"), *, seed=0):
    rng, n = np.random.default_rng(seed), len(kinds)
    place = rng.uniform((-10, 1, 8), (10, 2, 50), (n, 3))
    corner = rng.uniform(0, 50, (n, 2))
    return Boxes(
        place.astype(np.float32),
        rng.uniform(0.5, 5, (n, 3)).astype(np.float32),
        rng.uniform(-3, 3, n).astype(np.float32),
        np.concatenate([corner, corner + rng.uniform(5, 40, (n, 2))], axis=1).astype(np.float32),
        rng.random(n).astype(np.float32),
        rng.integers(0, 4, n).astype(np.int32),
        tuple(kinds),
    )


def some_frame(boxes=None, *, seed=0):
    rng = np.random.default_rng(seed)
    view = CameraFrame(rng.integers(0, 256, (*SIZE, 3)).astype(np.uint8), kitti_camera(SIZE))
    xyz = rng.uniform((3, -20, -2), (60, 20, 1), (500, 3)).astype(np.float32)
    cloud = Cloud(xyz, rng.random(500, np.float32), rng.random(500) < 0.9)
    return view, cloud, some_boxes(seed=seed) if boxes is None else boxes


def check_same(frame, view, cloud, boxes):
    keep = np.asarray(cloud.valid)
    assert (frame.cloud.xyz_m == np.asarray(cloud.xyz_m)[keep]).all()
    assert (frame.cloud.intensity == np.asarray(cloud.intensity)[keep]).all()
    assert (frame.camera.rgb == view.rgb).all()
    assert (frame.camera.camera.intrinsics == view.camera.intrinsics).all()
    assert (frame.camera.camera.cam_from_velo == view.camera.cam_from_velo).all()
    assert frame.boxes.kind == boxes.kind
    for name in ("centre_m", "size_m", "yaw_rad", "bbox_px", "truncated", "occluded"):
        assert (getattr(frame.boxes, name) == getattr(boxes, name)).all(), name


def test_a_frame_reads_back_to_the_last_bit(tmp_path):
    view, cloud, boxes = some_frame()
    write_kitti_frame(tmp_path, "000012", view, cloud=cloud, boxes=boxes)
    dataset = KittiObject(tmp_path, rows="elevation")
    assert (len(dataset), dataset.name_of(0)) == (1, "000012")
    check_same(dataset[0], view, cloud, boxes)


def test_kittis_own_frames_read_back_to_the_last_bit(tmp_path, samples):
    source = KittiObject(samples / "kitti_object")
    for k in range(3):
        frame = source[k]
        rect = frame.rect_from_velo
        write_kitti_frame(tmp_path, frame.name, frame.camera, cloud=frame.cloud, boxes=frame.boxes, rect_from_velo=rect)
    copy = KittiObject(tmp_path)
    for k in range(3):
        check_same(copy[k], source[k].camera, source[k].cloud, source[k].boxes)
        assert (copy[k].cloud.row == source[k].cloud.row).all()
        assert (copy[k].rect_from_velo == source[k].rect_from_velo).all()
    # An independent reader finds the objects' points in the copy as in the original.
    write_image_sets(tmp_path, {"trainval": ["000000", "000001", "000002"]})
    counts = [
        [int(rules.points_in(box, frame["points"]).sum()) for box in frame["boxes"]]
        for frame in rules.accept(tmp_path).values()
    ]
    assert counts == [[377], [71, 9, 18], [1349, 67]]


def test_the_tree_is_what_an_independent_reader_asks_for(tmp_path):
    for k in range(3):
        view, cloud, boxes = some_frame(some_boxes(("Car", "DontCare", "Cyclist", "DontCare"), seed=k), seed=k)
        write_kitti_frame(tmp_path, f"{k:06d}", view, cloud=cloud, boxes=boxes)
        expected = choose_boxes(boxes, np.array([True, False, True, False]))
        write_image_sets(tmp_path, {"trainval": [f"{i:06d}" for i in range(k + 1)][::-1]})
        frames = rules.accept(tmp_path)
        assert list(frames) == [f"{i:06d}" for i in range(k + 1)]
        frame = frames[f"{k:06d}"]
        assert (frame["points"][:, :3] == cloud.xyz_m[cloud.valid]).all()
        assert [thing["kind"] for thing in frame["objects"]] == ["Car", "Cyclist"]
        ours = lidar_boxes(expected, view.camera.cam_from_velo)
        assert frame["boxes"][:, :6] == pytest.approx(ours[:, :6], abs=1e-4)
        assert np.cos(frame["boxes"][:, 6] - ours[:, 6]) == pytest.approx(1)
    names = list(frames)
    truth = read_truth(tmp_path / "training/label_2", names)
    assert (truth.kind == "DontCare").sum() == 6
    assert len(truth.frame) == 12


def test_a_labels_frame_beside_the_camera_becomes_the_fourth_column_of_p2(tmp_path):
    view, cloud, boxes = some_frame()
    rect = view.camera.cam_from_velo.astype(np.float64)
    rect[:3, 3] -= (0.06, 0.001, 0.003)
    write_kitti_frame(tmp_path, "000000", view, cloud=cloud, boxes=boxes, rect_from_velo=rect)
    assert (object_rect_from_velo(tmp_path / "training/calib/000000.txt") == rect).all()
    check_same(KittiObject(tmp_path, rows="elevation")[0], view, cloud, boxes)
    turned = rect.copy()
    turned[:3, :3] = turned[:3, :3][::-1]
    with pytest.raises(ValueError, match="turned against the camera's"):
        calibration_text(view.camera, turned)


def test_fractions_replace_levels_where_they_are_given():
    boxes = some_boxes(("Car", "DontCare", "Van"))
    lines = label_lines(replace(boxes, occluded=np.array([0.25, 0, 1], np.float32)))
    assert [line.split()[2] for line in lines] == ["0.25", "1", "-1"]
    assert [line.split()[0] for line in lines] == ["Car", "Van", "DontCare"]


def test_objects_beyond_the_reach_are_told_and_dont_care_regions_have_no_place():
    boxes = some_boxes(("Car", "Car", "DontCare"))
    place = np.array([[0, 1, 79.9], [40, 1, 70], [0, 0, 1e4]], np.float32)
    near = within_reach(replace(boxes, centre_m=place))
    assert near.tolist() == [True, False, True]
    assert choose_boxes(boxes, near).kind == ("Car", "DontCare")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"valid": np.zeros(500, bool)}, "holds no point"),
        ({"intensity": None}, "has no intensity; write 0 for all"),
        ({"intensity": np.full(500, 200, np.float32)}, r"000000: intensity spans 200..200; it must lie in 0..1"),
        ({"xyz_m": np.full((500, 3), np.nan, np.float32)}, "000000: 500 of 500 points are NaN or infinite"),
    ],
)
def test_clouds_that_no_reader_would_take_are_refused_and_nothing_is_written(tmp_path, change, message):
    view, cloud, boxes = some_frame()
    cloud = replace(cloud, valid=np.ones(500, bool))
    with pytest.raises(ValueError, match=message):
        write_kitti_frame(tmp_path, "000000", view, cloud=replace(cloud, **change), boxes=boxes)
    assert not (tmp_path / "training").exists()


@pytest.mark.parametrize(
    "change",
    [
        {"centre_m": np.full((3, 3), np.nan, np.float32)},
        {"size_m": np.zeros((3, 3), np.float32)},
        {"bbox_px": np.full((3, 4), np.inf, np.float32)},
        {"kind": ("Car", "Person sitting", "Van")},
    ],
)
def test_boxes_that_are_no_boxes_are_refused(change):
    with pytest.raises(ValueError, match=r"object [01]"):
        label_lines(replace(some_boxes(), **change))


def test_the_label_is_the_last_of_a_frames_files(tmp_path):
    assert [path.parent.name for path in tree_files(tmp_path, "000001")] == ["velodyne", "calib", "image_2", "label_2"]


def test_the_pages_own_frame_is_a_tree(tmp_path, monkeypatch):
    page = (Path(__file__).parents[2] / "docs" / "kitti-tree.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(block, {})
    frame = rules.accept(tmp_path / "tree")["000000"]
    assert len(frame["objects"]) == 1
    assert rules.points_in(frame["boxes"][0], frame["points"]).sum() > 10
