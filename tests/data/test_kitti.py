import re
import shutil

import numpy as np
import pytest

from jaxsim.config import DataConfig
from jaxsim.data import KittiObject, KittiRaw, open_dataset, select
from jaxsim.geometry import UnorderedCloud, project


def test_drives_come_in_order_and_each_is_a_scene(raw_root):
    dataset = open_dataset(DataConfig(kind="kitti_raw", root=raw_root))
    assert len(dataset) == 3
    frames = [dataset[i] for i in range(3)]
    assert [f.scene for f in frames] == [f"2011_09_26_drive_{d}_sync" for d in ("0001", "0001", "0002")]
    assert frames[1].name == "2011_09_26_drive_0001_sync-0000000001"
    assert [f.time_s for f in frames] == [None] * 3


def test_a_frame_has_rgb_in_order_and_a_laser_line_for_every_point(raw_root):
    frame = KittiRaw(raw_root)[0]
    assert frame.camera.rgb.shape == (375, 1242, 3)
    np.testing.assert_array_equal(frame.camera.rgb[0, 0], [30, 20, 10])
    np.testing.assert_array_equal(frame.cloud.row, np.round(frame.cloud.intensity * 100))
    assert frame.cloud.valid.all()


def test_iterating_ends_after_the_last_frame(raw_root):
    assert len(list(KittiRaw(raw_root))) == 3


def test_numbers_that_lack_scan_or_image_are_left_out(raw_root):
    (raw_root / "2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data/0000000000.bin").unlink()
    assert [frame.name[-10:] for frame in KittiRaw(raw_root)] == ["0000000001", "0000000000"]


def test_scans_without_an_image_are_told(raw_root, caplog):
    (raw_root / "2011_09_26/2011_09_26_drive_0001_sync/image_02/data/0000000001.png").unlink()
    assert len(KittiRaw(raw_root)) == 2
    assert re.search(r"1 scan of 2 in .*drive_0001_sync.* left out, .* no image .*: 0000000001$", caplog.messages[0])


def test_drives_without_images_or_scans_do_no_harm(raw_root):
    date = raw_root / "2011_09_26"
    (date / "2011_09_26_drive_0000_sync/velodyne_points/data").mkdir(parents=True)
    first = next(date.glob("*/velodyne_points/data/*.bin"))
    for name in ("2011_09_26_drive_0000_sync", "2011_09_26_drive_0099_sync"):
        scan = date / name / "velodyne_points/data/0000000003.bin"
        scan.parent.mkdir(parents=True, exist_ok=True)
        scan.write_bytes(first.read_bytes())
    (date / "2011_09_26_drive_0099_sync/image_02/data").mkdir(parents=True)
    empty = date / "2011_09_26_drive_0100_sync"
    (empty / "velodyne_points/data").mkdir(parents=True)
    before = [frame for frame in KittiRaw(raw_root)._frames if "0000_sync" not in frame[0].name]
    assert KittiRaw(raw_root)._frames == before
    assert len(before) > 0


def test_a_drive_of_images_that_are_not_png_is_told_and_refused_by_name(raw_root, caplog):
    date = raw_root / "2011_09_26"
    (date / "2011_09_26_drive_0002_sync/image_02/data/0000000000.png").rename(
        date / "2011_09_26_drive_0002_sync/image_02/data/0000000000.jpg"
    )
    dataset = KittiRaw(raw_root)
    why = r"drive_0002_sync/image_02/data holds 0000000000\.jpg; expected NUMBER\.png files in it"
    assert re.search(rf"1 of 2 drives left out: kitti: .*{why}", caplog.messages[0])
    for name in ("drive_0002", "all but 2011_09_26_drive_0002"):
        with pytest.raises(ValueError, match=why):
            select(name, dataset)
    assert select("all but 0", dataset) == [1]
    shutil.rmtree(date / "2011_09_26_drive_0001_sync")
    with pytest.raises(ValueError, match=why):
        KittiRaw(raw_root)


def test_a_drive_that_is_left_out_takes_no_name_from_one_that_is_there(raw_root):
    other = raw_root / "2011_09_28"
    shutil.copytree(raw_root / "2011_09_26", other)
    for drive in other.glob("*_sync"):
        shutil.rmtree(drive / "image_02")
        drive.rename(other / drive.name.replace("09_26", "09_28"))
    dataset = KittiRaw(raw_root)
    assert select("drive_0001", dataset) == [0, 1]
    with pytest.raises(ValueError, match=r"no folder .*2011_09_28_drive_0001_sync/image_02/data"):
        select("2011_09_28_drive_0001", dataset)


def test_drives_are_parts_by_name(raw_root):
    dataset = KittiRaw(raw_root)
    scenes = [dataset.name_of(i).split("-")[0] for i in range(len(dataset))]
    for name, positions in dataset.splits.items():
        assert select(name, dataset) == positions
        assert {scenes[i] for i in positions} == {f"2011_09_26_{name}_sync"}
        assert select(f"all but {name}", dataset) == [i for i in range(len(dataset)) if i not in positions]
    assert sorted(i for positions in dataset.splits.values() for i in positions) == list(range(len(dataset)))


def test_a_drive_number_of_two_dates_is_told_by_its_date(raw_root):
    other = raw_root / "2011_09_28"
    shutil.copytree(raw_root / "2011_09_26", other)
    for drive in other.glob("*_sync"):
        drive.rename(other / drive.name.replace("09_26", "09_28"))
    dataset = KittiRaw(raw_root)
    assert all(name.startswith(("2011_09_26_drive_", "2011_09_28_drive_")) for name in dataset.splits)
    name = next(reversed(dataset.splits))
    assert [dataset.name_of(i)[: len(name)] for i in select(name, dataset)] == [name] * len(dataset.splits[name])


def test_time_stamps_are_seconds_since_1970(raw_root):
    path = raw_root / "2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/timestamps.txt"
    path.write_text("1970-01-01 00:00:02.250000001\n1970-01-02 00:00:00.000000000\n")
    frames = KittiRaw(raw_root)
    assert [frames[i].time_s for i in range(3)] == [2.25, 86400.0, None]
    path.write_text("1970-01-02 00:00:00.000000000\n1970-01-01 00:00:02.250000001\n")
    with pytest.warns(UserWarning, match="line 2 lies before the line above it: a clock was set"):
        assert KittiRaw(raw_root)[1].time_s == 2.25
    path.write_text("1970-01-01 00:00:02.250000001\n")
    with pytest.raises(ValueError, match="has 1 lines, none for frame 1"):
        frames[1]
    path.write_text("noon\n")
    with pytest.raises(ValueError, match="'noon' is no time"):
        frames[0]


def test_speed_and_heading_come_from_oxts_where_it_is(raw_root):
    # Two lines of the format: lat lon alt roll pitch yaw vn ve vf vl vu, 3 x accelerations, f l u, 3 x rates, f l u,
    # accuracies, navstat numsats posmode velmode orimode.
    line = "49.01 8.43 116.4 0.035 0.005 -0.602 -5.1 7.4 8.99 -0.02 0.01 " + "0.1 " * 14 + "4 11 6 6 6"
    folder = raw_root / "2011_09_26/2011_09_26_drive_0001_sync/oxts/data"
    folder.mkdir(parents=True)
    (folder / "0000000001.txt").write_text(line + "\n")
    frames = KittiRaw(raw_root)
    assert [(frames[i].speed_mps, frames[i].heading_rad) for i in range(3)] == [
        (None, None),
        (8.99, -0.602),
        (None, None),
    ]
    (folder / "0000000000.txt").write_text("49.01 8.43 116.4\n")
    with pytest.raises(ValueError, match="has 3 values; an oxts file holds 30"):
        frames[0]
    (folder / "0000000000.txt").write_text("north " * 30)
    with pytest.raises(ValueError, match="holds 30 numbers"):
        frames[0]
    (folder / "0000000000.txt").write_text(line.replace("8.99", "8990"))
    with pytest.raises(ValueError, match=r"0000000000\.txt: the speed is 8990; it must be in m/s"):
        frames[0]


def test_the_projection_matrix_keeps_its_fourth_column(object_root):
    frame = KittiObject(object_root)[0]
    lines = (object_root / "training/calib/000007.txt").read_text().splitlines()
    p2, r0, velo = (np.array(line.split()[1:], float) for line in lines[:3])
    to_rectified = np.eye(4)
    to_rectified[:3] = r0.reshape(3, 3) @ velo.reshape(3, 4)
    xyz = np.array([[10.0, 2, -1], [40, -9, 0.5], [5, 0, 1]], np.float32)
    u, v, depth = p2.reshape(3, 4) @ to_rectified @ np.concatenate([xyz, np.ones((3, 1))], axis=1).T
    uv, z = project(frame.camera.camera, xyz)
    np.testing.assert_allclose(z, depth, atol=1e-4)
    np.testing.assert_allclose(uv, np.stack([u / depth, v / depth], axis=1), atol=2e-3)


def test_raw_and_object_calibration_of_one_drive_agree(raw_root, object_root):
    raw, single = KittiRaw(raw_root)[0], KittiObject(object_root)[0]
    np.testing.assert_allclose(raw.camera.camera.cam_from_velo, single.camera.camera.cam_from_velo, atol=1e-6)
    np.testing.assert_array_equal(raw.camera.camera.intrinsics, single.camera.camera.intrinsics)


def test_labels_are_boxes_and_dont_care_is_a_rectangle_alone(object_root):
    boxes = KittiObject(object_root)[0].boxes
    assert boxes.kind == ("Car", "DontCare")
    np.testing.assert_allclose(boxes.size_m[0], [3.69, 1.87, 1.67])
    np.testing.assert_allclose(boxes.centre_m[0], [-16.53, 2.39, 58.49])
    np.testing.assert_allclose(boxes.yaw_rad, [1.57, 0])
    np.testing.assert_allclose(boxes.bbox_px[1], [503.89, 169.71, 590.61, 190.13])
    assert not boxes.centre_m[1].any()
    assert boxes.occluded.tolist() == [0, 0]


def test_a_frame_without_objects_has_no_boxes_and_an_unlabelled_split_has_none(object_root):
    (object_root / "training/label_2/000007.txt").write_text("")
    assert len(KittiObject(object_root)[0].boxes.kind) == 0
    (object_root / "training/label_2/000007.txt").unlink()
    (object_root / "training/label_2").rmdir()
    assert KittiObject(object_root)[0].boxes is None


def test_a_frame_whose_label_file_is_missing_has_no_labels(object_root):
    (object_root / "training/label_2/000007.txt").unlink()
    assert KittiObject(object_root)[0].boxes is None


def test_reduced_clouds_are_found(object_root):
    training = object_root / "training"
    (training / "velodyne").rename(training / "velodyne_reduced")
    assert len(KittiObject(object_root)) == 1
    (training / "velodyne").mkdir()  # whole ones that are not there yet
    assert len(KittiObject(object_root)) == 1


def test_a_shuffled_cloud_needs_elevations_on_request(object_root):
    path = object_root / "training/velodyne/000007.bin"
    points = np.fromfile(path, "<f4").reshape(-1, 4)
    np.random.default_rng(0).permutation(points).tofile(path)
    with pytest.raises(UnorderedCloud, match=r'000007\.bin: .*rows="elevation"'):
        KittiObject(object_root)[0]
    cloud = KittiObject(object_root, rows="elevation")[0].cloud
    np.testing.assert_array_equal(cloud.row, np.round(cloud.intensity * 100))
    with pytest.raises(ValueError, match="it is 'file_order' or 'elevation'"):
        KittiObject(object_root, rows="azimuth")


def test_the_sensor_is_fitted_to_the_first_scan(raw_root):
    spec = KittiRaw(raw_root).spec
    assert spec.rows == 64
    assert "0000000000" in spec.name
    hash(spec)


@pytest.mark.parametrize(("kind", "count"), [("kitti_raw", 6), ("kitti_object", 3), ("kitti_object_fovcrop", 1)])
def test_real_frames_are_read(samples, kind, count):
    config = DataConfig(kind="kitti_raw" if kind == "kitti_raw" else "kitti_object", root=samples / kind)
    dataset = open_dataset(config)
    assert len(dataset) == count
    frame = dataset[count - 1]
    row = frame.cloud.row
    assert (np.diff(row) >= 0).all()
    assert row.min() == 0
    assert row.max() == (63 if kind != "kitti_object_fovcrop" else 45)
    elevation = np.rad2deg(np.arctan2(frame.cloud.xyz_m[:, 2], np.hypot(*frame.cloud.xyz_m[:, :2].T)))
    assert 1.5 < np.median(elevation[row == 0]) < 5.0
    assert len(dataset.spec.elevation_deg) == 64


def test_rows_of_real_scans_equal_the_published_ones(samples, golden):
    dataset = KittiObject(samples / "kitti_object")
    published = np.load(golden / "rows/rows.npz")
    for i in range(3):
        frame = dataset[i]
        np.testing.assert_array_equal(frame.cloud.row, published[f"row_{frame.name}"])
