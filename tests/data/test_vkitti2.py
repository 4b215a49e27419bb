"""Virtual KITTI 2: the generated files hold what the format asks for, and the reader gives back what was rendered."""

import cv2
import numpy as np
import pytest
from PIL import Image

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset, select
from jaxsim.data.cityscapes import IDS
from jaxsim.data.synthetic import kitti_camera
from jaxsim.data.vkitti2 import VirtualKitti2
from jaxsim.data.vkitti2_files import CITYSCAPES_OF, COLOURS, OBJECT_KINDS
from jaxsim.geometry import preset, unproject
from jaxsim.prepare import dense_view, prepare_frame
from tests.data.virtual_drives import BASELINE_M, K

RASTERS = {
    "rgb/Camera_{}/rgb_{:05d}.jpg",
    "depth/Camera_{}/depth_{:05d}.png",
    "classSegmentation/Camera_{}/classgt_{:05d}.png",
    "instanceSegmentation/Camera_{}/instancegt_{:05d}.png",
}
ONE = ("Scene01",)


@pytest.fixture(scope="module")
def dataset(virtual) -> VirtualKitti2:
    return VirtualKitti2(virtual.root, scenes=ONE)


def rows_of(folder, name: str) -> list[list[str]]:
    return [line.split() for line in (folder / f"{name}.txt").read_text().splitlines()][1:]


def test_scenes_are_named_parts(dataset):
    assert dataset.splits == {"Scene01": list(range(len(dataset)))}
    assert select("Scene01", dataset) == [0, 1]


def test_the_generated_images_have_the_published_format(virtual):
    frames = virtual.root / "Scene01/clone/frames"
    named = {path.format(camera, n) for path in RASTERS for camera in (0, 1) for n in (0, 1)}
    assert {str(p.relative_to(frames)) for p in frames.rglob("*.*")} == named
    for camera in (0, 1):
        depth = cv2.imread(str(frames / f"depth/Camera_{camera}/depth_00000.png"), cv2.IMREAD_UNCHANGED)
        assert (depth.dtype, depth.shape) == (np.uint16, (375, 1242))
        shot = virtual.drawn[0, camera]
        assert (depth[~shot.valid] == 65535).all()
        assert depth.min() > 0
        classes = Image.open(frames / f"classSegmentation/Camera_{camera}/classgt_00000.png")
        assert classes.mode == "RGB"
        colours = np.asarray(classes)
        assert {tuple(c) for c in np.unique(colours.reshape(-1, 3), axis=0).tolist()} <= set(COLOURS.values())
        instances = Image.open(frames / f"instanceSegmentation/Camera_{camera}/instancegt_00000.png")
        assert instances.mode == "P"
        vehicle = (colours[..., None, :] == [COLOURS[kind] for kind in OBJECT_KINDS]).all(axis=-1).any(axis=-1)
        np.testing.assert_array_equal(np.asarray(instances) > 0, vehicle)
        assert (frames / f"rgb/Camera_{camera}/rgb_00000.jpg").read_bytes().startswith(b"\xff\xd8\xff")  # JPEG


def test_the_generated_texts_have_the_published_format(virtual):
    folder = virtual.root / "Scene01/clone"
    widths = {"colors": 4, "info": 4, "intrinsic": 6, "extrinsic": 18, "bbox": 11, "pose": 19}
    for name, width in widths.items():
        lines = (folder / f"{name}.txt").read_text().splitlines()
        assert len(lines) > 1
        assert {len(line.split()) for line in lines} == {width}
    assert {tuple(row[2:]) for row in rows_of(folder, "intrinsic")} == {("725.0087", "725.0087", "620.5", "187")}
    cam_from_world = {tuple(row[:2]): np.array(row[2:], float).reshape(4, 4) for row in rows_of(folder, "extrinsic")}
    moved = cam_from_world["0", "1"] @ np.linalg.inv(cam_from_world["0", "0"])
    np.testing.assert_allclose(moved[:3, 3], [-BASELINE_M, 0, 0], atol=1e-4)
    boxes = {tuple(row[:3]): row[3:] for row in rows_of(folder, "bbox")}
    poses = rows_of(folder, "pose")
    assert {tuple(row[:3]) for row in poses} == set(boxes)
    assert {row[0] for row in rows_of(folder, "info")} >= {row[2] for row in poses}
    for row in poses:
        alpha, _, _, _, *rest = (float(v) for v in row[3:])
        world, (x, y, z), yaw = rest[:3], rest[6:9], rest[9]
        assert np.cos(alpha - yaw + np.arctan2(x, z)) > 1 - 1e-6
        there = cam_from_world[row[0], row[1]] @ [*world, 1]
        np.testing.assert_allclose(there[:3], [x, y, z], atol=1e-3)
        left, right, top, bottom, pixels = (int(v) for v in boxes[tuple(row[:3])][:5])
        truncation, occupancy = (float(v) for v in boxes[tuple(row[:3])][5:7])
        assert 0 <= left <= right <= 1241
        assert 0 <= top <= bottom <= 374
        assert 0 <= truncation <= 1
        assert occupancy == pytest.approx(pixels / max((right - left) * (bottom - top), 1), rel=1e-5)
    assert {row[-1] for row in rows_of(folder, "bbox")} <= {"True", "False"}


@pytest.mark.parametrize("camera", [0, 1])
def test_frames_are_what_was_rendered(virtual, camera):
    dataset = VirtualKitti2(virtual.root, scenes=ONE, camera=camera)
    assert len(dataset) == 2
    frame, shot = dataset[0], virtual.drawn[0, camera]
    assert frame.name == dataset.name_of(0) == f"Scene01-clone-Camera_{camera}-00000"
    assert (frame.scene, frame.cloud) == ("Scene01", None)
    view = frame.camera
    near = shot.valid & (shot.depth_m <= 119.9)
    np.testing.assert_array_equal(view.depth_valid[near], True)
    assert not view.depth_valid[~shot.valid | (shot.depth_m > 120.1)].any()
    np.testing.assert_allclose(view.depth_m[near], shot.depth_m[near], atol=0.0051)
    names = np.array([IDS[CITYSCAPES_OF[name]] for name in COLOURS])
    np.testing.assert_array_equal(view.semantic, names[shot.classes])
    np.testing.assert_array_equal(view.instance, shot.tracks)
    assert np.abs(view.rgb.astype(int) - shot.rgb).mean() < 4  # JPEG
    np.testing.assert_array_equal(view.camera.intrinsics, K)
    np.testing.assert_allclose(view.camera.cam_from_velo, shot.camera.cam_from_velo, atol=1e-4)


def test_the_road_lies_under_the_lidar_wherever_it_is(virtual):
    for lidar, height in (("kitti", -1.73), ("camera", -1.65)):
        view = VirtualKitti2(virtual.root, scenes=ONE, lidar=lidar)[0].camera
        xyz = np.asarray(unproject(view.camera, view.depth_m))
        road = view.depth_valid & (view.semantic == IDS["road"]) & (view.depth_m < 15)
        assert np.median(xyz[road][:, 2]) == pytest.approx(height, abs=0.15)
        assert (xyz[view.depth_valid][:, 0] > 0).all()
    np.testing.assert_array_equal(view.camera.cam_from_velo[:3, 3], 0)


def test_a_lidar_as_on_kittis_car_stands_by_the_left_camera_for_both(virtual):
    left, right = (VirtualKitti2(virtual.root, scenes=ONE, camera=k)[0].camera.camera for k in (0, 1))
    np.testing.assert_allclose(left.cam_from_velo, kitti_camera().cam_from_velo, atol=1e-6)
    np.testing.assert_allclose(right.cam_from_velo[0, 3] - left.cam_from_velo[0, 3], -BASELINE_M, atol=1e-4)


def test_depth_beyond_the_completed_depths_reach_is_unknown(virtual):
    view = VirtualKitti2(virtual.root, scenes=ONE, reach_m=30.0)[0].camera
    assert view.depth_m.max() <= 30
    assert (view.depth_m[~view.depth_valid] == 0).all()


def test_boxes_are_of_vehicles_that_are_seen_and_never_wholly_visible(dataset, virtual):
    boxes, shot = dataset[0].boxes, virtual.drawn[0, 0]
    seen = [thing for thing in dataset.objects(0) if thing.pixels]
    assert len(seen) < len(dataset.objects(0))
    assert boxes.kind == tuple(thing.kind for thing in seen)
    assert set(boxes.occluded.tolist()) <= {1, 2, 3}
    assert set(boxes.kind) <= set(OBJECT_KINDS)
    for thing, (left, top, right, bottom) in zip(seen, boxes.bbox_px.astype(int), strict=True):
        v, u = np.nonzero(shot.tracks == thing.track + 1)
        assert (u.min(), v.min(), u.max(), v.max()) == (left, top, right, bottom)
        assert len(u) == thing.pixels


def test_configs_choose_scene_variation_camera_and_lidar(virtual):
    variations = ("clone", "fog", "clone")
    config = DataConfig(kind="vkitti2", root=virtual.root, scenes=ONE, variations=variations, camera=1)
    dataset = open_dataset(config)
    assert len(dataset) == 4
    assert [dataset.name_of(i) for i in (0, 3)] == ["Scene01-clone-Camera_1-00000", "Scene01-fog-Camera_1-00001"]
    assert {dataset[i].scene for i in range(4)} == {"Scene01"}


def test_folders_in_lower_case_are_found(virtual_root):
    scene = virtual_root / "Scene01"
    frames = scene / "clone/frames"
    for name in ("classSegmentation", "instanceSegmentation"):
        (frames / name).rename(frames / name.lower())
    for camera in frames.glob("*/Camera_0"):
        camera.rename(camera.with_name("camera_0"))
    scene.rename(virtual_root / "scene01")
    assert VirtualKitti2(virtual_root, scenes=ONE)[0].name == "scene01-clone-Camera_0-00000"


def test_a_frame_without_lidar_is_not_for_training_and_keeps_its_depth(dataset):
    frame = dataset[0]
    config = PrepareConfig(depth="ip_basic")
    with pytest.raises(ValueError, match=r"Scene01-clone-Camera_0-00000 has no cloud: .* it is for jaxsim simulate"):
        prepare_frame(frame, preset("hdl64e"), config)
    view = dense_view(frame, config)
    np.testing.assert_array_equal(view.depth_m, frame.camera.depth_m[-352:, 13:-13])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, r"no Scene02, Scene06, Scene18, Scene20: .* holds Scene01/; .*--data.scenes Scene01"),
        ({"scenes": ("Scene03",)}, "no scene 'Scene03'; there are Scene01, Scene02"),
        ({"scenes": ONE, "variations": ("snow",)}, "no variation 'snow'; known: 15-deg-left"),
        ({"scenes": ONE, "variations": ("rain",)}, r"no rain/: .* holds clone/"),
        ({"scenes": ONE, "variations": ()}, "no variation ''"),
        ({"scenes": ONE, "camera": 2}, "camera is 2; it is 0 .left. or 1"),
        ({"scenes": ONE, "lidar": "roof"}, "lidar is 'roof'"),
    ],
)
def test_what_is_missing_or_unknown_is_explained(virtual_root, settings, message):
    with pytest.raises(ValueError, match=message):
        VirtualKitti2(virtual_root, **settings)


@pytest.mark.parametrize("kind", ["depth", "classSegmentation", "instanceSegmentation"])
def test_an_image_without_one_of_its_rasters_is_an_error(virtual_root, kind):
    next((virtual_root / f"Scene01/clone/frames/{kind}/Camera_0").glob("*_00001.png")).unlink()
    with pytest.raises(ValueError, match=rf"1 of 2 images have no \w+ .the first: 00001.; unpack .*_{kind} beside"):
        VirtualKitti2(virtual_root, scenes=ONE)


@pytest.mark.parametrize(
    ("kind", "spoil", "message"),
    [
        ("depth", lambda i: (i // 256).astype(np.uint8), r"is uint8 .*16-bit grey PNG in centimetres"),
        ("depth", lambda i: np.where(i == 65535, 0, i), r"depth is 0 in \d+ pixels; .* is this KITTI's encoding"),
        ("depth", lambda i: np.stack([i] * 3, -1), r"is uint16 with shape \(375, 1242, 3\)"),
        ("classSegmentation", lambda i: i + np.uint8(1), r"\d+ pixels have a colour of no class, the first \("),
        ("classSegmentation", lambda i: i[..., 0], r"classes are an 8-bit RGB PNG"),
        ("instanceSegmentation", lambda i: i, r"is no indexed PNG \(colour type 2, 8 bits\)"),
    ],
)
def test_a_raster_in_another_encoding_is_an_error(virtual_root, kind, spoil, message):
    path = next((virtual_root / f"Scene01/clone/frames/{kind}/Camera_0").glob("*_00000.png"))
    assert cv2.imwrite(str(path), spoil(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))
    with pytest.raises(ValueError, match=message):
        VirtualKitti2(virtual_root, scenes=ONE)[0]


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("colors", "Road 100", "Street 100", "unknown class 'Street'; known: Terrain, Sky"),
        ("colors", "Category r g b", "r g b", "begins with 'r g b'; its header is 'Category r g b'"),
        ("intrinsic", "0 0 725.0087", "0 0 7x", "is no number"),
        ("intrinsic", "0 0 725", "5 0 725", r"intrinsic\.txt has no line for frame 0 and camera 0"),
        ("extrinsic", "frame cameraID", "frame", "begins with 'frame r1,1"),
        ("info", " Car ", " Tank ", "unknown label 'Tank'"),
        ("bbox", "0 0 ", "7 0 ", r"track \d+ is not in bbox\.txt or info\.txt"),
    ],
)
def test_broken_texts_are_explained(virtual_root, name, old, new, message):
    path = virtual_root / f"Scene01/clone/{name}.txt"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=message):
        VirtualKitti2(virtual_root, scenes=ONE)[0]


def test_colours_of_a_scenes_own_file_hold_and_may_leave_some_out(virtual_root):
    folder = virtual_root / "Scene01/clone"
    path = folder / "colors.txt"
    path.write_text("".join(line + "\n" for line in path.read_text().splitlines() if "Undefined" not in line))
    first = VirtualKitti2(virtual_root, scenes=ONE)[0].camera.semantic
    path.unlink()
    np.testing.assert_array_equal(VirtualKitti2(virtual_root, scenes=ONE)[1].camera.semantic.shape, first.shape)
