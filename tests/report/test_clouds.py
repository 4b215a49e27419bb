"""Pages and pictures of simulated clouds, and of those that a detector has looked at: boxes lie where the labels and
the calibration files of real KITTI frames say that they are."""

import numpy as np
import pytest

from jaxsim.data import KittiObject, open_dataset
from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.detect.results import Detected
from jaxsim.detect.scenes import scene_of_frame
from jaxsim.evaluate.cloud_folder import AT_LIDAR, CloudFolder, write_detections
from jaxsim.frame import Cloud, Painted, PolarGrid, PolarImage
from jaxsim.report.clouds import (
    detection_picture,
    draw_above,
    draw_on_image,
    draw_simulated,
    write_detected,
    write_simulated,
)
from jaxsim.report.pictures import FOUND, LABEL
from tests.detect.tiny import EXPERIMENT

ROWS, COLUMNS = 4, 16
RANGE_M = np.full((ROWS, COLUMNS), 9.0, np.float32)
IMAGE = PolarImage(RANGE_M, RANGE_M / 20, RANGE_M > 0)
SEEN_M = (0.0, -40.0, -3.0, 70.4, 40.0, 1.0)
FRAMES = (0, 1, 2)
NOTHING = Detected(np.zeros((0, 7), np.float32), np.zeros(0, np.float32))


def test_the_page_turns_frames_beside_what_the_data_set_measured(tmp_path):
    azimuth = np.linspace(0.6, -0.6, COLUMNS).astype(np.float32)
    elevation = np.linspace(0.0, -0.3, ROWS).astype(np.float32)
    world = open_dataset("synthetic")
    write_grid(tmp_path / "polar", PolarGrid(azimuth, elevation, np.zeros(ROWS, np.float32)))
    write_frame(tmp_path / "polar", world.name_of(3), IMAGE)
    page = write_simulated(tmp_path, world, [3], run="demo")
    assert page == tmp_path / "clouds.html"
    assert "The sensor of demo, simulated beside what was measured." in page.read_text()


def test_a_frame_has_a_picture_of_its_cloud_and_one_of_its_rasters(tmp_path):
    cells = np.zeros((ROWS, COLUMNS), np.int32)
    rgb = np.zeros((ROWS, COLUMNS, 3), np.float32)
    painted = Painted(RANGE_M, RANGE_M, rgb, cells, cells, valid=RANGE_M > 0, occluded=RANGE_M < 0)
    cloud = Cloud(np.ones((5, 3), np.float32), np.ones(5, np.float32), np.ones(5, bool))
    draw_simulated(tmp_path, "a", cloud, image=IMAGE, painted=painted)
    assert {path.name for path in (tmp_path / "previews").iterdir()} == {"a.png", "a_cloud.png"}


def test_what_result_files_hold_is_drawn_and_turned(tmp_path):
    rng = np.random.default_rng(0)
    boxes = np.array([[10, 2, -1, 4, 2, 1.5, 0.3]], np.float32)
    clouds, out = tmp_path / "clouds", tmp_path / "out"
    clouds.mkdir()
    for name in ("a", "b"):
        rng.uniform(0, 1, (50, 4)).astype(np.float32).tofile(clouds / f"{name}.bin")
        found = Detected(boxes, np.array([0.7], np.float32))
        write_detections(out / "results" / f"{name}.txt", found, "Car", view=AT_LIDAR)
    folder = CloudFolder(clouds)
    page = write_detected(folder, [clouds / "a.bin"], out, experiment=EXPERIMENT, sentence="Cars in two clouds.")
    assert page == out / "clouds.html"
    assert "Cars in two clouds." in page.read_text()
    assert [path.name for path in (out / "pictures").iterdir()] == ["a_above.png"]


@pytest.fixture(scope="module")
def kitti(samples):
    return KittiObject(samples / "kitti_object")


def matrices(samples, number):
    """P2, and the labels' frame from the LiDAR's, straight from the file."""
    lines = (samples / f"kitti_object/training/calib/{number:06d}.txt").read_text().split("\n")
    values = {name: np.array(row.split(), float) for name, row in (line.split(":") for line in lines if ":" in line)}
    rect, velo = np.eye(4), np.eye(4)
    rect[:3, :3], velo[:3] = values["R0_rect"].reshape(3, 3), values["Tr_velo_to_cam"].reshape(3, 4)
    return values["P2"].reshape(3, 4), rect @ velo


def labelled_corners(samples, number):
    """(n, 8, 3) in the labels' frame by the devkit's rule: front (+x of the object), below first."""
    corners = []
    for line in (samples / f"kitti_object/training/label_2/{number:06d}.txt").read_text().splitlines():
        if line.startswith("DontCare"):
            continue
        height, width, length, x, y, z, turn = map(float, line.split()[8:15])
        cos, sin = np.cos(turn), np.sin(turn)
        local = [
            (a * length / 2, -b * height, c * width / 2)
            for b in (0, 1)
            for a, c in ((1, 1), (1, -1), (-1, -1), (-1, 1))
        ]
        corners.append([(cos * u + sin * w + x, v + y, -sin * u + cos * w + z) for u, v, w in local])
    return np.array(corners)


def is_drawn(picture, at, colour, *, within=1):
    """Whether a pixel so near to a place (column, row) has the colour, or a third of it and more over black."""
    column, row = (round(float(v)) for v in at)
    rows, columns = (slice(max(v - within, 0), v + within + 1) for v in (row, column))
    near = picture[rows, columns].reshape(-1, 3).astype(float)
    size = np.linalg.norm(near, axis=1)
    alike = near @ np.array(colour) / np.maximum(size * np.linalg.norm(colour), 1) > 0.95
    return bool((alike & (size > np.linalg.norm(colour) / 3)).any())


@pytest.mark.parametrize("number", FRAMES)
def test_labels_are_drawn_where_their_corners_project(kitti, samples, number):
    frame, (p2, _) = kitti[number], matrices(samples, number)
    scene = scene_of_frame(frame, "Car", in_image=True)
    image = np.asarray(frame.camera.rgb)

    def drawn(background):
        return draw_on_image(background, scene.view, detected=NOTHING, labelled=scene.boxes)

    picture, bare = drawn(image), drawn(np.zeros_like(image))
    corners = labelled_corners(samples, number)
    pixel = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=-1) @ p2.T
    uv = pixel[..., :2] / pixel[..., 2:]
    rows, columns = image.shape[:2]
    inside = ((uv >= 1) & (uv < [columns - 1, rows - 1])).all(axis=-1)
    assert len(uv) == len(scene.boxes)
    assert inside.sum() >= 6 * len(uv)
    # A box stands upright in the LiDAR's axes, a label in the camera's, which lean by up to a degree: 2 px at 7 m.
    missing = [at.tolist() for at in uv[inside] if not is_drawn(bare, at, LABEL, within=3)]
    assert not missing
    # On the image the same is drawn: nothing far from the objects, but for the legend.
    changed = np.argwhere((picture != image).any(axis=-1))[:, ::-1]
    low, high = uv.reshape(-1, 2).min(axis=0) - 3, uv.reshape(-1, 2).max(axis=0) + 3
    beyond = ((changed < low) | (changed > high)).any(axis=1)
    assert (changed[beyond][:, 1] < 28).all()


def test_what_is_found_is_orange_and_a_box_behind_the_camera_is_not_drawn(kitti):
    frame = kitti[1]
    scene = scene_of_frame(frame, "Car", in_image=True)
    image, score = np.zeros_like(np.asarray(frame.camera.rgb)), np.float32([0.87, 0.5])
    behind = scene.boxes[0] * np.float32([-1, 1, 1, 1, 1, 1, 1])
    picture = draw_on_image(image, scene.view, detected=Detected(np.stack([scene.boxes[0], behind]), score))
    alone = draw_on_image(image, scene.view, detected=Detected(scene.boxes[:1], score[:1]))
    np.testing.assert_array_equal(picture, alone)
    orange = (np.abs(picture.astype(int) - FOUND).max(axis=-1) < 60)[28:]
    green = (np.abs(picture.astype(int) - LABEL).max(axis=-1) < 60)[28:]
    assert orange.sum() > 50
    assert not green.any()


@pytest.mark.parametrize("number", FRAMES)
def test_from_above_the_corners_and_the_line_to_the_front_lie_where_the_labels_say(kitti, samples, number):
    scene = scene_of_frame(kitti[number], "Car", in_image=True)
    height = 1408
    picture = draw_above(scene.points[:0], SEEN_M, detected=NOTHING, labelled=scene.boxes, height=height)
    assert picture.shape == (height, 1600, 3)
    _, rect_from_velo = matrices(samples, number)
    corners = labelled_corners(samples, number)
    velo = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=-1) @ np.linalg.inv(rect_from_velo).T
    uv = np.stack([(40 - velo[..., 1]) * 20, (70.4 - velo[..., 0]) * 20], axis=-1)
    for eight in uv:
        assert all(is_drawn(picture, at, LABEL) for at in eight[:4])
        middle, front, rear = eight.mean(axis=0), eight[:2].mean(axis=0), eight[2:4].mean(axis=0)
        assert is_drawn(picture, (middle + front) / 2, LABEL)
        assert not is_drawn(picture, (middle + rear) / 2, LABEL)


def test_points_are_where_they_are_and_only_targets_count_as_labelled(kitti):
    """Frame 1 has a car, a truck and a cyclist: the picture of a car detector shows the car alone."""
    scene = scene_of_frame(kitti[1], "Car", in_image=True)
    picture = detection_picture(scene, NOTHING, SEEN_M, title="")
    only = draw_above(scene.points, SEEN_M, detected=NOTHING, labelled=scene.boxes[scene.target], title="000001")
    assert 0 < scene.target.sum() < len(scene.target)
    np.testing.assert_array_equal(picture, only)
    scale = 900 / 70.4
    inside = (scene.points[:, 0] < 70) & (np.abs(scene.points[:, 1]) < 39)
    at = np.floor(np.column_stack([40 - scene.points[inside, 1], 70.4 - scene.points[inside, 0]]) * scale).astype(int)
    at = at[at[:, 1] > 28]
    assert (picture[at[:, 1], at[:, 0]] != 12).any(axis=1).all()
