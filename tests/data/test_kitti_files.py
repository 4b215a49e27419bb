"""Every slip in the files or in their layout has an error of its own, which says what to do."""

import shutil

import cv2
import numpy as np
import pytest

from jaxsim.data import KittiObject, KittiRaw
from jaxsim.data.kitti_files import read_image, read_plane

DRIVE = "2011_09_26/2011_09_26_drive_0001_sync"
IMAGE = np.random.default_rng(0).integers(0, 255, (20, 30, 3)).astype(np.uint8)


def _spoil(path, change):
    points = np.fromfile(path, "<f4").reshape(-1, 4)
    change(points)
    points.tofile(path)


@pytest.fixture
def velodyne(raw_root):
    return raw_root / DRIVE / "velodyne_points/data/0000000000.bin"


def test_a_truncated_scan(raw_root, velodyne):
    velodyne.write_bytes(velodyne.read_bytes()[:-3])
    with pytest.raises(ValueError, match=r"0000000000\.bin is truncated: \d+ bytes"):
        KittiRaw(raw_root)[0]


def test_an_empty_scan(raw_root, velodyne):
    velodyne.write_bytes(b"")
    with pytest.raises(ValueError, match="is empty"):
        KittiRaw(raw_root)[0]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_points_that_are_not_finite(raw_root, velodyne, value):
    def change(points):
        points[[5, 9], 1] = value

    _spoil(velodyne, change)
    with pytest.raises(ValueError, match=r"2 of \d+ points are NaN or infinite"):
        KittiRaw(raw_root)[0]


@pytest.mark.parametrize(("value", "span"), [(255.0, r"0\.\.255"), (-0.5, r"-0\.5\.\.0\.63")])
def test_intensity_of_another_scale(raw_root, velodyne, value, span):
    def change(points):
        points[7, 3] = value

    _spoil(velodyne, change)
    with pytest.raises(ValueError, match=rf"intensity spans {span}; it must lie in 0\.\.1"):
        KittiRaw(raw_root)[0]


@pytest.mark.parametrize("name", ["calib_cam_to_cam.txt", "calib_velo_to_cam.txt"])
def test_missing_calibration(raw_root, name):
    (raw_root / "2011_09_26" / name).unlink()
    with pytest.raises(ValueError, match=f"there is no .*{name}"):
        KittiRaw(raw_root)[0]


def test_missing_object_calibration(object_root):
    (object_root / "training/calib/000007.txt").unlink()
    with pytest.raises(ValueError, match=r"there is no .*calib/000007\.txt"):
        KittiObject(object_root)[0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("P2:", "P9:", r"has no P2 \(it has P9, R0_rect, Tr_velo_to_cam\)"),
        ("Tr_velo_to_cam:", "Tr_velo_to_cam: 1", "Tr_velo_to_cam has 13 numbers; it must have 12"),
        ("721.5377 0 ", "nan 0 ", "NaN or infinite numbers"),
        ("721.5377 0 ", "f 0 ", "is no number"),
    ],
)
def test_broken_calibration(object_root, old, new, message):
    path = object_root / "training/calib/000007.txt"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=message):
        KittiObject(object_root)[0]


def test_an_image_of_another_size_than_the_raw_calibration_says(raw_root):
    cv2.imwrite(str(raw_root / DRIVE / "image_02/data/0000000000.png"), np.zeros((370, 1224, 3), np.uint8))
    with pytest.raises(ValueError, match=r"0000000000\.png is 1224 x 370, but .*calib_cam_to_cam\.txt says 1242 x 375"):
        KittiRaw(raw_root)[0]


def test_an_image_that_the_object_calibration_cannot_belong_to(object_root):
    cv2.imwrite(str(object_root / "training/image_2/000007.png"), np.zeros((187, 621, 3), np.uint8))
    with pytest.raises(ValueError, match=r"optical axis at \(610, 173\), far from the middle .* 621 x 187"):
        KittiObject(object_root)[0]


def test_a_file_that_is_no_image(raw_root):
    (raw_root / DRIVE / "image_02/data/0000000000.png").write_bytes(b"no image")
    with pytest.raises(ValueError, match=r"0000000000\.png is not an image"):
        KittiRaw(raw_root)[0]


def label(kind="Car", occluded: object = 0, box="100 110 180 160", size="1.5 1.6 3.9", place="1 1.6 20", yaw="0"):
    return f"{kind} 0 {occluded} 0 {box} {size} {place} {yaw}"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Car 0.00 0 1.85", "line 1 has 4 columns; a label has 15"),
        ("Car" + " 0" * 15, "line 1 has 16 columns"),
        ("Bus" + " 0" * 14, "unknown kind 'Bus'; known: Car, Van"),
        ("Car 0.00 1.35" + " 0" * 12, "line 1: occluded is 1.35; it is a whole number 0..3, or the hidden share"),
        ("Car 0.00 0 x" + " 0" * 11, "is no number"),
        (label(occluded=-1), "line 1: occluded is -1; it is a whole number 0..3, or the hidden share"),
        (label(occluded=4), "line 1: occluded is 4; it is a whole number 0..3, or the hidden share"),
        (label().replace("Car 0", "Car -1"), r"line 1: truncated is -1; it is the share outside the image, 0\.\.1"),
        (label(box="180 110 100 160"), "line 1: the rectangle of Car is 180 110 100 160; it must be left, top, right"),
        (label(kind="DontCare", box="1 4 2 3"), "line 1: the rectangle of DontCare is 1 4 2 3"),
        (label(occluded="nan"), "line 1: occluded of Car is nan; it must be finite"),
        (label(yaw="inf"), "line 1: rotation_y of Car is inf"),
        (label(place="0 -inf 20"), "line 1: y of Car is -inf"),
        (f"{label()}\n{label(kind='Van', place='nan 1.6 20')}", "line 2: x of Van is nan"),
        (label(box="1 2 nan 4"), "line 1: right of Car is nan"),
        (label(kind="DontCare", box="1 2 nan 4"), "line 1: right of DontCare is nan"),
        (label(size="nan 1.6 3.9"), "line 1: height of Car is nan"),
        (label(size="1.5 0 3.9"), "line 1: Car is 1.5 x 0 x 3.9 m .*sizes must be above 0"),
        (f"{label()}\n\n{label(size='-1 -1 -1')}", "line 3: Car is -1 x -1 x -1 m"),
        (f"{label(occluded=0.4)}\n{label(occluded=2)}", "line 2: occluded is 2, but line 1 has a fraction"),
    ],
)
def test_broken_labels(object_root, line, message):
    (object_root / "training/label_2/000007.txt").write_text(line)
    with pytest.raises(ValueError, match=message):
        KittiObject(object_root)[0]


def test_a_region_may_have_the_sizes_that_an_object_may_not(object_root):
    region = "DontCare -1 -1 -10 100 110 180 160 -1 -1 -1 -1000 -1000 -1000 -10"
    (object_root / "training/label_2/000007.txt").write_text(f"{label(occluded=2)}\n{region}\n")
    boxes = KittiObject(object_root)[0].boxes
    assert boxes.kind == ("Car", "DontCare")
    assert boxes.occluded.dtype == np.int32
    assert boxes.occluded.tolist() == [2, 0]


def test_hidden_shares_are_read_as_such_beside_regions_and_whole_ends(object_root):
    region = "DontCare -1 -1 -10 100 110 180 160 -1 -1 -1 -1000 -1000 -1000 -10"
    lines = [label(occluded=0.35), label(occluded=1), region]
    (object_root / "training/label_2/000007.txt").write_text("\n".join(lines))
    boxes = KittiObject(object_root)[0].boxes
    assert boxes.occluded.dtype == np.float32
    assert boxes.occluded.tolist() == pytest.approx([0.35, 1, 0])


def test_raw_layout_slips_say_what_was_found_and_what_to_pass(raw_root, object_root, tmp_path):
    for root, message in [
        (raw_root / "2011_09_26", "is the folder of one date; pass the folder above it"),
        (raw_root / DRIVE, "is the folder of one drive; pass the folder two levels up"),
        (object_root, r"holds training/: this is the object benchmark; use --data\.kind kitti_object"),
        (tmp_path, r"no date folder: .* holds object/, raw/; pass the folder that holds 2011_09_26/"),
        (tmp_path / "none", "there is no folder .*none; pass the one that holds 2011_09_26/"),
    ]:
        with pytest.raises(ValueError, match=message):
            KittiRaw(root)


def test_object_layout_slips_say_what_was_found_and_what_to_pass(raw_root, object_root, tmp_path):
    for root, message in [
        (object_root / "training", "is a split of the object benchmark; pass the folder above it"),
        (raw_root, r"holds 2011_09_26/: these are raw drives; use --data\.kind kitti_raw"),
        (tmp_path / "raw/2011_09_26", "no training/: .* pass the folder that holds training/velodyne"),
    ]:
        with pytest.raises(ValueError, match=message):
            KittiObject(root)


def test_missing_folders_inside_a_drive(raw_root, object_root):
    for drive in (raw_root / "2011_09_26").glob("*_sync"):
        shutil.rmtree(drive / "image_02")
    with pytest.raises(ValueError, match=r"there is no folder .*image_02/data; expected NUMBER\.png files"):
        KittiRaw(raw_root)
    shutil.rmtree(object_root / "training/velodyne")
    with pytest.raises(ValueError, match=r"there is no folder .*training/velodyne; expected NUMBER\.bin files"):
        KittiObject(object_root)


def test_scans_and_images_of_different_frames(object_root):
    training = object_root / "training"
    (training / "velodyne/000007.bin").rename(training / "velodyne/000008.bin")
    with pytest.raises(ValueError, match=r"000008\.bin, \.\.\.\) has an image of the same number"):
        KittiObject(object_root)


def test_a_date_without_drives(raw_root):
    for drive in (raw_root / "2011_09_26").glob("*_sync"):
        shutil.rmtree(drive)
    with pytest.raises(ValueError, match=r"no drive with velodyne_points/: .*holds calib_cam_to_cam\.txt"):
        KittiRaw(raw_root)


def test_a_road_plane_in_other_units_is_refused(tmp_path):
    path = tmp_path / "000000.txt"
    path.write_text("# Matrix\nWIDTH 4\nHEIGHT 1\n-7.05e-03 -9.99e-01 -1.78e-02 1.65e+03\n")
    with pytest.raises(ValueError, match=r"000000\.txt: the road lies 1651\.\d+ m from the camera"):
        read_plane(path)


@pytest.mark.parametrize("normal", ["0 0 1", "1 1e-9 0"])
def test_a_wall_is_no_road(tmp_path, normal):
    path = tmp_path / "000000.txt"
    path.write_text(f"# Matrix\nWIDTH 4\nHEIGHT 1\n{normal} 1.65\n")
    with pytest.raises(ValueError, match=rf"000000\.txt: the road's normal is {normal}; a road's points up"):
        read_plane(path)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_cut_image_is_refused_not_filled_with_grey(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), IMAGE)
    whole = path.read_bytes()
    for length in (0, 1, 8, 30, len(whole) // 2, len(whole) - 3):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=f"a{suffix} is not an image that can be read"):
            read_image(path)


def test_no_flipped_bit_of_a_png_gives_other_pixels(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), IMAGE)
    whole = path.read_bytes()
    for place in np.random.default_rng(1).integers(0, 8 * len(whole), 100):
        flipped = bytearray(whole)
        flipped[place // 8] ^= 1 << (place % 8)
        path.write_bytes(flipped)
        with pytest.raises(ValueError, match=r"a\.png is (not )?an image"):
            read_image(path)


def test_other_formats_are_named(tmp_path):
    (tmp_path / "a.png").write_bytes(b"GIF89a" + bytes(100))
    with pytest.raises(ValueError, match="neither PNG nor JPEG"):
        read_image(tmp_path / "a.png")
