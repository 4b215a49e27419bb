"""KITTI-STEP: the generated files hold what the format asks for, and the reader gives back what was rendered."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from jaxsim.config import DataConfig
from jaxsim.data import KittiStep, open_dataset, select
from jaxsim.data.cityscapes import IDS
from jaxsim.data.kitti_step import EVALUATION, LENGTHS, NO_SCAN, SEQUENCES
from jaxsim.geometry import project
from tests.data.drives import STEP_THINGS, TRAIN_ID, write_png

TWO = ("0000", "0001")


@pytest.fixture(scope="module")
def dataset(step_tree) -> KittiStep:
    return KittiStep(step_tree, sequences=TWO)


def test_the_published_lengths_add_up_to_the_papers_two_parts():
    judged = sum(LENGTHS[int(sequence)] for sequence in EVALUATION)
    assert (len(SEQUENCES), sum(LENGTHS.values()), judged) == (21, 8008, 2126)
    assert sum(LENGTHS.values()) - judged == 5882
    assert sorted(NO_SCAN) == [("0001", f"{n:06d}") for n in (177, 178, 179, 180)]


@pytest.mark.long
def test_the_generated_files_have_the_published_format(step_tree):
    scan = np.fromfile(step_tree / "training/velodyne/0000/000000.bin", "<f4").reshape(-1, 4)
    assert 80_000 < len(scan) < 130_000
    np.testing.assert_allclose(scan[:, 3] * 100, np.round(scan[:, 3] * 100), atol=1e-4)
    assert scan[:, 3].max() <= np.float32(0.99)
    assert np.linalg.norm(scan[:, :3], axis=1).min() > 0.5  # rays without return are left out
    calibration = (step_tree / "training/calib/0000.txt").read_text().splitlines()
    assert [line.split()[0] for line in calibration] == [
        *("P0:", "P1:", "P2:", "P3:"),
        *("R_rect", "Tr_velo_cam", "Tr_imu_velo"),
    ]
    maps = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted(step_tree.glob("panoptic_maps/*/*/*.png"))]
    for image in maps:
        assert (image.dtype, image.shape) == (np.uint8, (375, 1242, 3))
        blue, green, red = (image[..., k].astype(int) for k in range(3))
        assert set(np.unique(red)) <= {*range(19), 255}
        things = {TRAIN_ID[i] for i in STEP_THINGS}
        assert set(np.unique(red[green * 256 + blue > 0])) <= things == {11, 13}
    lines = [line.split() for line in (step_tree / "training/label_02/0001.txt").read_text().splitlines()]
    assert {len(line) for line in lines} == {17}
    assert {line[0] for line in lines} == {"176", "177"}
    for line in lines:
        if line[2] == "DontCare":
            assert line[1] == "-1"
            continue
        assert line[3] in "012"
        alpha, x, z, yaw = (float(line[k]) for k in (5, 13, 15, 16))
        assert np.cos(alpha - yaw + np.arctan2(x, z)) > 1 - 1e-9


@pytest.mark.long
def test_frames_are_what_was_rendered(dataset, street):
    assert [dataset.name_of(i) for i in range(len(dataset))] == ["0000-000000", "0001-000176"]
    for i, rendered in enumerate(street):
        frame = dataset[i]
        assert frame.scene == TWO[i]
        np.testing.assert_array_equal(frame.camera.rgb, rendered.camera.rgb)
        np.testing.assert_allclose(frame.camera.camera.intrinsics, rendered.camera.camera.intrinsics, rtol=1e-6)
        np.testing.assert_allclose(frame.camera.camera.cam_from_velo, rendered.camera.camera.cam_from_velo, atol=1e-6)
        np.testing.assert_allclose(frame.cloud.xyz_m, rendered.cloud.xyz_m, atol=6e-4)
        np.testing.assert_array_equal(frame.cloud.row, rendered.cloud.row)
        semantic = rendered.camera.semantic
        np.testing.assert_array_equal(frame.camera.semantic, np.where(np.isin(semantic, list(TRAIN_ID)), semantic, 0))
        boxes = frame.boxes
        assert boxes.kind == (*rendered.boxes.kind, "DontCare")
        np.testing.assert_allclose(boxes.centre_m[:-1], rendered.boxes.centre_m, atol=1e-5)
        np.testing.assert_allclose(boxes.size_m[:-1], rendered.boxes.size_m, atol=1e-5)


def test_instances_are_unique_over_classes_and_split_as_rendered(dataset, street):
    view, rendered = dataset[0].camera, street[0].camera
    thing = np.isin(rendered.semantic, STEP_THINGS) & (rendered.instance > 0)
    np.testing.assert_array_equal(view.instance > 0, thing)
    pairs = np.unique(np.stack([view.instance[thing], rendered.instance[thing], rendered.semantic[thing]]), axis=1)
    # A thing of two classes is two instances; else one number each.
    assert len(np.unique(pairs[0])) == pairs.shape[1]
    np.testing.assert_array_equal(pairs[0] // 1000, [TRAIN_ID[i] for i in pairs[2]])


def test_scan_and_labels_of_a_frame_belong_together(dataset):
    frame = dataset[1]
    uv, depth = (np.asarray(a) for a in project(frame.camera.camera, frame.cloud.xyz_m))
    inside = (depth > 1) & (np.abs(uv[:, 0] - 620.5) < 620) & (np.abs(uv[:, 1] - 187) < 187)
    u, v = np.round(uv[inside]).astype(int).T
    seen = frame.camera.semantic[v, u]
    assert (seen == IDS["sky"]).mean() < 0.02
    below = frame.cloud.xyz_m[inside][seen == IDS["road"], 2]
    assert np.median(below) == pytest.approx(-1.73, abs=0.15)


def test_the_papers_parts_are_named(dataset, step_tree):
    assert dataset.splits == {"training": [0], "evaluation": [1]}
    assert select("evaluation", dataset) == [1]
    with pytest.raises(ValueError, match=r"no frame of evaluation is here; --data\.scenes"):
        select("evaluation", KittiStep(step_tree, sequences=("0000",)))


def test_configs_open_it_and_tracking_needs_no_panoptic_maps(step_root):
    (step_root / "panoptic_maps").rename(step_root / "elsewhere")
    config = DataConfig(kind="kitti_tracking", root=step_root, scenes=TWO)
    frame = open_dataset(config)[0]
    assert frame.camera.semantic is None
    with pytest.raises(ValueError, match=r"no panoptic_maps/: .*--data\.kind kitti_tracking"):
        open_dataset(replace(config, kind="kitti_step"))
    (step_root / "kitti-step").mkdir()
    (step_root / "elsewhere").rename(step_root / "kitti-step" / "panoptic_maps")
    assert len(open_dataset(replace(config, kind="kitti_step"))) == 2


def test_a_missing_sequence_is_an_error_that_names_those_there(step_root):
    with pytest.raises(ValueError, match=r"no sequence 0002, 0003, .*--data\.scenes 0000 0001"):
        KittiStep(step_root)
    with pytest.raises(ValueError, match=r"no labelled sequence '0021'; there are 0000 to 0020"):
        KittiStep(step_root, sequences=("0021",))
    (step_root / "panoptic_maps/train/0001").rename(step_root / "panoptic_maps/train/0003")
    with pytest.raises(ValueError, match="no panoptic maps of sequence 0001"):
        KittiStep(step_root, sequences=TWO)


def test_an_image_without_scan_is_an_error_but_where_none_was_published(step_root):
    (step_root / "training/velodyne/0001/000176.bin").unlink()
    with pytest.raises(ValueError, match=r"sequence 0001: 1 of 1 images have no scan \(000176\); copy them"):
        KittiStep(step_root, sequences=TWO)


def test_an_image_without_panoptic_map_is_an_error(step_root):
    (step_root / "panoptic_maps/train/0000/000000.png").unlink()
    with pytest.raises(ValueError, match=r"sequence 0000: 1 of 1 images have no panoptic map \(000000\)"):
        KittiStep(step_root, sequences=TWO)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda i: i[..., 0], "uint8 with shape .375, 1242.; a panoptic map is an 8-bit RGB PNG"),
        (lambda i: i.astype(np.uint16), "is uint16 with shape"),
        (lambda i: i[:370], "is 1242 x 370, its image 1242 x 375"),
        (
            lambda i: np.where(i == 255, 26, i + 0 * i).astype(np.uint8) * 0 + 26,
            "class 26 is no train id of Cityscapes",
        ),
        (
            lambda i: np.stack([0 * i[..., 0], i[..., 0] * 0 + 4, i[..., 2]], -1),
            "instance 1024, but they stay below 1000",
        ),
    ],
)
def test_a_panoptic_map_in_another_encoding_is_an_error(step_root, spoil, message):
    path = step_root / "panoptic_maps/train/0000/000000.png"
    write_png(path, spoil(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))
    with pytest.raises(ValueError, match=message):
        KittiStep(step_root, sequences=("0000",))[0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0 -1 DontCare -1", "0 -1 DontCare", "has 16 columns and starts with '0'; a tracking label has 17"),
        ("0 -1 DontCare -1", "Car -1 DontCare -1", "17 columns and starts with 'Car'"),
        ("DontCare", "Lorry", "unknown kind 'Lorry'"),
    ],
)
def test_broken_labels_are_explained(step_root, old, new, message):
    path = step_root / "training/label_02/0000.txt"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=message):
        KittiStep(step_root, sequences=("0000",))[0]


def test_a_sitting_person_has_one_name_and_a_frame_without_objects_no_boxes(step_root):
    path = step_root / "training/label_02/0000.txt"
    path.write_text("0 3 Person 0 1 0.1 1 2 3 4 1.2 0.5 0.6 1 1.7 9 0.2\n")
    boxes = KittiStep(step_root, sequences=("0000",))[0].boxes
    assert boxes.kind == ("Person_sitting",)
    np.testing.assert_allclose(boxes.size_m, [[0.6, 0.5, 1.2]])
    path.write_text("7 3 Person 0 1 0.1 1 2 3 4 1.2 0.5 0.6 1 1.7 9 0.2\n")
    assert len(KittiStep(step_root, sequences=("0000",))[0].boxes.kind) == 0


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ({"image_02": 0}, "is a split of the tracking set; pass the folder above"),
        ({"training/image_2": 0}, r"is the object benchmark; use --data\.kind kitti_object"),
        ({"other": 0}, r"no training/image_02/: .* holds other/"),
    ],
)
def test_a_wrong_folder_is_explained(tmp_path, layout, message):
    for folder in layout:
        (tmp_path / folder).mkdir(parents=True)
    with pytest.raises(ValueError, match=message):
        KittiStep(tmp_path)
