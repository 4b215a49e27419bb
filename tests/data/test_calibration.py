"""Calibrations that are none are refused, wherever they are written."""

import re

import numpy as np
import pytest

from jaxsim.data import KittiObject, KittiRaw
from jaxsim.data.calibration import check_pinhole, check_rigid
from jaxsim.data.vkitti2 import VirtualKitti2

K = np.array([[721.5, 0, 609.6], [0, 721.5, 172.9], [0, 0, 1]])


def test_kittis_own_are_taken(raw_root, object_root):
    assert KittiRaw(raw_root)[0].camera.camera.intrinsics[0, 0] == pytest.approx(721.5377)
    assert KittiObject(object_root)[0].camera.camera.intrinsics[0, 0] == pytest.approx(721.5377)
    check_pinhole(K, (375, 1242), "here")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda k: k * [[0.5], [0.5], [1]], "focal lengths of 360"),  # with its axis: halved as the image would be
        (lambda k: np.diag([360.7, 360.7, 1]) + k * (1 - np.eye(3)), "a view of 120 degrees"),
        (lambda k: np.diag([360.7, 721.5, 1]) + k * (1 - np.eye(3)), "both must be alike"),
        (lambda k: np.diag([-721.5, 721.5, 1]) + k * (1 - np.eye(3)), "is no camera matrix"),
        (lambda k: k * np.nan, "is no camera matrix"),
        (lambda k: k * 2, "is no camera matrix"),
    ],
)
def test_what_is_no_camera_is_refused(change, message):
    with pytest.raises(ValueError, match=f"^here {message}|^here .*{message}"):
        check_pinhole(change(K), (375, 1242), "here")


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("R0_rect", lambda v: 2 * v, "is no rotation"),
        ("R0_rect", lambda v: -v, "is no rotation"),
        ("R0_rect", lambda v: np.ones(9), "is no rotation"),
        ("Tr_velo_to_cam", lambda v: v * np.tile([1, 1, 1, 1e30], 3), "moves by"),
        ("Tr_velo_to_cam", lambda v: v * np.tile([1, 1, 1, 1000], 3), "must be in metres"),
        ("Tr_velo_to_cam", lambda v: v * np.nan, "NaN or infinite"),
        ("P2", lambda v: v * ([0.5] + [1] * 11), "both must be alike"),
        ("P2", lambda v: v * ([0.5] + [1] * 4 + [0.5] + [1] * 6), "a view of 120 degrees"),
        ("P2", lambda v: v * ([-1] + [1] * 11), "is no camera matrix"),
        ("P2", lambda v: v + ([0] * 3 + [1e30] + [0] * 8), "camera's place by P2 moves by"),
    ],
)
def test_an_object_calibration_that_is_none_is_refused_with_file_and_name(object_root, name, change, message):
    path = object_root / "training/calib/000007.txt"
    text = path.read_text()
    line = re.search(rf"(?m)^{name}: (.*)$", text)
    assert line
    words = " ".join(map(repr, np.asarray(change(np.array(line[1].split(), float)), float).tolist()))
    path.write_text(text.replace(line[0], f"{name}: {words}"))
    with pytest.raises(ValueError, match=rf"000007\.txt.*{message}"):
        KittiObject(object_root)[0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("R: 0.007533745", "R: 0.5", r"calib_velo_to_cam\.txt: \[R \| T\] is no rotation"),
        ("T: -0.004069766", "T: 1e30", "moves by 1e"),
        ("T: -0.004069766", "T: nan", "NaN or infinite"),
        ("T: -0.004069766", "T: -0.004_069", "is no number"),
    ],
)
def test_so_is_that_of_a_raw_drive(raw_root, old, new, message):
    path = raw_root / "2011_09_26/calib_velo_to_cam.txt"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=message):
        KittiRaw(raw_root)[0]


def test_a_line_that_comes_twice_is_refused(object_root):
    path = object_root / "training/calib/000007.txt"
    path.write_text(path.read_text() + "R0_rect: 1 0 0 0 1 0 0 0 1\n")
    with pytest.raises(ValueError, match="has R0_rect twice"):
        KittiObject(object_root)[0]


@pytest.mark.parametrize(
    ("file", "column", "value", "message"),
    [
        ("extrinsic.txt", 2, "0.5", r"extrinsic\.txt, line 2 is no rotation"),
        ("extrinsic.txt", 5, "nan", "line 2 holds NaN"),
        ("extrinsic.txt", 5, "1e30", "line 2 holds a number beyond 1e"),
        ("intrinsic.txt", 2, "-725.0087", "is no camera matrix"),
        ("intrinsic.txt", 2, "362.5", "both must be alike"),
    ],
)
def test_so_are_those_of_virtual_kitti(virtual_root, file, column, value, message):
    path = virtual_root / "Scene01/clone" / file
    header, first, *rest = path.read_text().splitlines()
    words = first.split()
    words[column] = value
    path.write_text("\n".join([header, " ".join(words), *rest]) + "\n")
    with pytest.raises(ValueError, match=message):
        VirtualKitti2(virtual_root, scenes=["Scene01"])[0]


def test_a_frame_that_comes_twice_in_virtual_kittis_texts_is_refused(virtual_root):
    path = virtual_root / "Scene01/clone/extrinsic.txt"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, lines[1]]) + "\n")
    with pytest.raises(ValueError, match="which an earlier line has"):
        VirtualKitti2(virtual_root, scenes=["Scene01"])[0]


def test_a_transform_need_not_be_more_exact_than_its_digits():
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]).round(4)
    check_rigid(np.column_stack([turn, [0.1, 0.2, 0.3]]), "here")
