"""KITTI's depth completion set, in files of its true forms."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from jaxsim.config import DataConfig, DepthExperiment, PenetConfig, Stage
from jaxsim.data.kitti_depth import KittiDepth, read_kitti_depth
from jaxsim.prepare.depth.penet.training import Batches
from jaxsim.train.depth import frames_of

DRIVE, SIZE, CROP = "2011_09_26_drive_0002_sync", (80, 120), (64, 96)
CAMERA = {
    "S_rect_02": "120 80",
    "R_rect_00": "1 0 0 0 1 0 0 0 1",
    "P_rect_02": "60 0 60 0 0 60 40 0 0 0 1 0",
    "S_rect_03": "120 80",
    "P_rect_03": "62 0 58 -30 0 62 41 0 0 0 1 0",
}


def write_depth(path, depth_m, valid):
    cv2.imwrite(str(path), np.round(np.where(valid, depth_m, 0) * 256).astype(np.uint16))


@pytest.fixture
def depth(tmp_path):
    """ROOT with two training frames of each camera and one for validation, RAW with their images and calibration."""
    rng, root, raw = np.random.default_rng(0), tmp_path / "depth", tmp_path / "raw"
    date = raw / DRIVE[:10]
    for part, camera, number in (
        ("train", "image_02", "0000000005"),
        ("train", "image_02", "0000000006"),
        ("train", "image_03", "0000000005"),
        ("train", "image_03", "0000000006"),
        ("val", "image_02", "0000000007"),
    ):
        proj = root / part / DRIVE / "proj_depth"
        for kind, share in (("velodyne_raw", 0.1), ("groundtruth", 0.4)):
            path = proj / kind / camera / f"{number}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            metres = rng.uniform(2, 80, SIZE).astype(np.float32)
            write_depth(path, metres, rng.random(SIZE) < share)
        path = date / DRIVE / camera / "data" / f"{number}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), rng.integers(0, 256, (*SIZE, 3), dtype=np.uint8))
    (date / "calib_cam_to_cam.txt").write_text("".join(f"{k}: {v}\n" for k, v in CAMERA.items()))
    (date / "calib_velo_to_cam.txt").write_text("R: 0 -1 0 0 0 -1 1 0 0\nT: 0 0 0\n")
    return root, raw


def test_a_frame_is_its_four_files_cropped(depth):
    root, raw = depth
    frames = KittiDepth(root, raw, crop=CROP)
    assert len(frames) == 4
    assert frames.name_of(1) == f"{DRIVE}-image_02-0000000006"
    frame = frames[0]
    assert frame.rgb.shape == (*CROP, 3)
    truth = cv2.imread(str(frames.files[0].truth), cv2.IMREAD_UNCHANGED)[16:, 12:108]
    np.testing.assert_array_equal(frame.truth_m, truth / np.float32(256))
    np.testing.assert_array_equal(frame.known, truth > 0)
    assert frame.given.mean() == pytest.approx(0.1, abs=0.02)
    # 16 rows off the top, 12 columns off each side.
    np.testing.assert_array_equal(frame.intrinsics, [[60, 0, 48], [0, 60, 24], [0, 0, 1]])


def test_the_right_camera_has_its_own_images_depth_and_calibration(depth):
    root, raw = depth
    frames = KittiDepth(root, raw, crop=CROP)
    assert frames.name_of(2) == f"{DRIVE}-image_03-0000000005"
    assert {part.parent.name for part in (frames.files[2].sparse, frames.files[2].truth)} == {"image_03"}
    right = frames[2]
    image = cv2.imread(str(raw / DRIVE[:10] / DRIVE / "image_03" / "data" / "0000000005.png"))
    np.testing.assert_array_equal(right.rgb, image[16:, 12:108, ::-1])
    np.testing.assert_array_equal(right.intrinsics, [[62, 0, 46], [0, 62, 25], [0, 0, 1]])


def test_training_reads_frames_as_they_are_asked_for(depth, selected):
    root, raw = depth
    stage = Stage("branches", 1, 2, (32, 64), ())
    experiment = DepthExperiment(data=DataConfig(root=raw), depth_root=root, image_crop=CROP)
    train, validation = frames_of(experiment)
    assert (len(train), len(validation)) == (4, 1)
    assert train[0] is not train[0]  # nothing is kept
    batches = Batches(train, PenetConfig(stages=(stage, stage)), seed=0)
    assert (len(batches), [batches.place(k) for k in (1, 2)]) == (4, [(0, 0, 1), (1, 0, 0)])
    batch = batches[3]
    assert batch.rgb.shape == (2, 32, 64, 3)
    np.testing.assert_array_equal(batch.truth_m, batches[3].truth_m)
    judged = replace(experiment, depth_validation=selected)
    assert isinstance(frames_of(judged)[1], KittiDepth)
    np.testing.assert_array_equal(frames_of(judged)[1][0].truth_m, train[0].truth_m)
    with pytest.raises(ValueError, match=r"--depth-validation .* goes with --depth-root"):
        frames_of(replace(judged, depth_root=None))


def test_selected_validation_images_are_not_trained_on(depth, selected):
    with pytest.raises(ValueError, match=r"not to be trained on; give .* as --depth-root, and this one as --depth-val"):
        frames_of(DepthExperiment(depth_root=selected, image_crop=CROP))


def test_drives_without_images_are_named_before_training(depth, tmp_path):
    root, raw = depth
    (raw / DRIVE[:10] / DRIVE / "image_03").rename(tmp_path / "away")
    with pytest.raises(ValueError, match=rf"no .*{DRIVE}/image_03/data, and 0 more .* --data\.root must hold"):
        KittiDepth(root, raw, crop=CROP)


@pytest.fixture
def selected(depth, tmp_path):
    """The first frame in the form of val_selection_cropped."""
    root, raw = depth
    whole, selected = KittiDepth(root, raw, crop=CROP)[0], tmp_path / "val_selection_cropped"
    stem = f"{DRIVE}_image_0000000005_image_02"
    for folder in ("image", "velodyne_raw", "groundtruth_depth", "intrinsics"):
        (selected / folder).mkdir(parents=True)
    cv2.imwrite(str(selected / "image" / f"{stem}.png"), whole.rgb[..., ::-1])
    for folder, metres, mask in (
        ("velodyne_raw", whole.sparse_m, whole.given),
        ("groundtruth_depth", whole.truth_m, whole.known),
    ):
        write_depth(selected / folder / f"{stem.replace('_sync_image_', f'_sync_{folder}_')}.png", metres, mask)
    (selected / "intrinsics" / f"{stem}.txt").write_text(" ".join(str(x) for x in whole.intrinsics.ravel()))
    return selected


def test_the_selected_validation_images_are_read_too(depth, selected):
    root, raw = depth
    whole, frame = KittiDepth(root, raw, crop=CROP)[0], KittiDepth(selected, part="val", crop=CROP)[0]
    for name in ("rgb", "sparse_m", "given", "truth_m", "known", "intrinsics"):
        np.testing.assert_array_equal(getattr(frame, name), getattr(whole, name))


def test_the_demo_s_depth_is_read(samples):
    depth_m, valid = read_kitti_depth(samples / "kitti_depth_demo/depth/0000000005.png")
    assert valid.mean() > 0.1
    assert 1 < np.median(depth_m[valid]) < 80


def test_bad_input_says_what_to_do(depth, tmp_path):
    root, raw = depth
    with pytest.raises(ValueError, match="no ground truth under"):
        KittiDepth(tmp_path, raw)
    with pytest.raises(ValueError, match=r"images are in the raw drives; name their folder with --data\.root"):
        KittiDepth(root)
    with pytest.raises(ValueError, match="no part 'test'; known: train, val"):
        KittiDepth(root, raw, part="test")
    with pytest.raises(ValueError, match=r"smaller than the crop of 1216 x 352; lower --image-crop"):
        KittiDepth(root, raw)[0]
    grey = tmp_path / "grey.png"
    cv2.imwrite(str(grey), np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match="no 16-bit grey PNG"):
        read_kitti_depth(grey)
