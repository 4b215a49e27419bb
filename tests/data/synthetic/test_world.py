"""The embedded world as a data set: what a reader promises, and physics that can be counted."""

import numpy as np
import pytest

from jaxsim.data.synthetic import SyntheticWorld, TrueSensor, Truth, beam_gain, kitti_camera
from jaxsim.frame import Frame
from jaxsim.geometry import points_to_polar, preset, project, recover_rows

SIZE, COLUMNS = (188, 621), 512
CLASSES = {6, 7, 8, 11, 13, 17, 20, 21, 22, 23, 24, 25, 26, 27, 33}
THINGS = {24, 25, 26, 27, 33}
BUSY = 6
"""A frame with cars, people and boxes."""


@pytest.fixture(scope="module")
def world() -> SyntheticWorld:
    return SyntheticWorld(seed=1, columns=COLUMNS, image_size=SIZE)


@pytest.fixture(scope="module")
def frames(world: SyntheticWorld) -> list[Frame]:
    return [world[i] for i in (0, 4, BUSY, 9, 13)]


@pytest.fixture(scope="module")
def truths(world: SyntheticWorld) -> list[Truth]:
    return [world.truth(i) for i in (0, 4, BUSY, 9, 13)]


@pytest.mark.long
def test_a_frame_depends_on_seed_and_number_alone(world: SyntheticWorld, frames: list[Frame]) -> None:
    again = SyntheticWorld(seed=1, columns=COLUMNS, image_size=SIZE)[BUSY]
    first = frames[2]
    assert again.name == first.name == "synthetic-1-000006"
    for one, other in (
        (again.camera.rgb, first.camera.rgb),
        (again.camera.depth_m, first.camera.depth_m),
        (again.camera.instance, first.camera.instance),
        (again.cloud.xyz_m, first.cloud.xyz_m),
        (again.cloud.intensity, first.cloud.intensity),
    ):
        np.testing.assert_array_equal(one, other)
    other_world = SyntheticWorld(seed=2, columns=COLUMNS, image_size=SIZE)[BUSY]
    assert np.mean(other_world.camera.rgb != first.camera.rgb) > 0.5


@pytest.mark.long
def test_a_drive_is_one_street_that_the_car_passes_through(world: SyntheticWorld) -> None:
    here, next_, elsewhere = world[4], world[5], world[8]
    assert here.scene == next_.scene != elsewhere.scene
    assert next_.time_s == pytest.approx(here.time_s + 0.1)
    assert next_.speed_mps == here.speed_mps > 0
    assert abs(next_.heading_rad - here.heading_rad) < 0.05
    moved = np.mean(np.abs(here.camera.rgb.astype(int) - next_.camera.rgb))
    assert 0 < moved < np.mean(np.abs(here.camera.rgb.astype(int) - elsewhere.camera.rgb))


def test_numbers_outside_the_world_are_refused(world: SyntheticWorld) -> None:
    for number in (-len(world) - 1, len(world)):
        with pytest.raises(IndexError, match=rf"synthetic: there is no frame {number}; .* 0 to 999999"):
            world[number]


def test_a_number_below_0_counts_from_the_end(world: SyntheticWorld) -> None:
    last = len(world) - 1
    there, here = world[-1], world[last]
    assert there.name == here.name == world.name_of(-1) == world.name_of(last)
    assert there.scene == here.scene
    np.testing.assert_array_equal(there.cloud.intensity, here.cloud.intensity)
    np.testing.assert_array_equal(world.truth(-1).image.range_m, world.truth(last).image.range_m)


def test_labels_are_cityscapes_ids_and_only_things_have_instances(frames: list[Frame]) -> None:
    seen = set()
    for frame in frames:
        camera = frame.camera
        seen |= set(np.unique(camera.semantic).tolist())
        numbered = np.isin(camera.semantic, list(THINGS))
        np.testing.assert_array_equal(camera.instance > 0, numbered)
        np.testing.assert_array_equal(camera.depth_valid, camera.semantic != 23)
        assert camera.depth_m[camera.depth_valid].min() > 0.5
        assert np.isfinite(camera.depth_m).all()
    assert seen <= CLASSES
    assert {7, 8, 11, 21, 23, 26} <= seen


def test_points_come_line_by_line_counter_clockwise_from_straight_ahead(frames: list[Frame]) -> None:
    for frame in frames:
        cloud = frame.cloud
        assert cloud.valid.all()
        assert (np.diff(cloud.row) >= 0).all()
        azimuth = np.arctan2(cloud.xyz_m[:, 1], cloud.xyz_m[:, 0]) % (2 * np.pi)
        assert (np.diff(azimuth)[np.diff(cloud.row) == 0] > 0).all()
        np.testing.assert_array_equal(recover_rows(cloud.xyz_m), cloud.row)


def test_intensities_are_hundredths_below_one(frames: list[Frame]) -> None:
    for frame in frames:
        steps = frame.cloud.intensity * np.float32(100)
        assert frame.cloud.intensity.dtype == np.float32
        np.testing.assert_allclose(steps, np.round(steps), atol=2e-5)
        assert 0 <= frame.cloud.intensity.min() <= frame.cloud.intensity.max() <= np.float32(0.99)


def test_the_cloud_is_the_measured_raster(world: SyntheticWorld, frames: list[Frame], truths: list[Truth]) -> None:
    image = world.measure(BUSY, truths[2])
    back, _ = points_to_polar(frames[2].cloud, world.grid)
    np.testing.assert_array_equal(back.valid, image.valid)
    np.testing.assert_allclose(np.asarray(back.range_m), image.range_m, atol=2e-4)
    np.testing.assert_array_equal(back.intensity, image.intensity)


def test_lidar_points_lie_on_the_camera_s_depth_but_where_one_sees_behind_the_other(frames: list[Frame]) -> None:
    shares = []
    for frame in frames:
        uv, depth = (np.asarray(v) for v in project(frame.camera.camera, frame.cloud.xyz_m))
        inside = depth > 1.0
        inside[inside] = ((uv[inside] >= 0) & (uv[inside] <= np.array(SIZE[::-1]) - 1)).all(axis=1)
        u, v = np.round(uv[inside]).astype(int).T
        near_m, valid = frame.camera.depth_m[v, u], frame.camera.depth_valid[v, u]
        wrong = (np.abs(near_m - depth[inside]) > 0.15 + 0.05 * depth[inside]) | ~valid
        shares.append(wrong.mean())
    assert np.mean(shares) < 0.10
    assert min(shares) > 0.002, "the camera sees all that the LiDAR sees: they stand at the same place"


def test_boxes_hold_the_points_of_their_objects(
    world: SyntheticWorld, frames: list[Frame], truths: list[Truth]
) -> None:
    checked = 0
    for frame, truth in zip(frames, truths, strict=True):
        boxes = frame.boxes
        measured = world.measure(int(frame.name[-6:]), truth)
        _, winner = points_to_polar(frame.cloud, world.grid)
        instance = truth.scan.instance[measured.valid]
        xyz = frame.cloud.xyz_m[np.asarray(winner)[measured.valid]]
        moved = frame.camera.camera.cam_from_velo
        cam = xyz @ moved[:3, :3].T + moved[:3, 3]
        for centre, size, yaw in zip(boxes.centre_m, boxes.size_m, boxes.yaw_rad, strict=True):
            # KITTI: x along the length is (cos, 0, -sin) of rotation_y; y points down, from the bottom face.
            along, aside = np.array([np.cos(yaw), 0, -np.sin(yaw)]), np.array([np.sin(yaw), 0, np.cos(yaw)])
            own = cam - centre
            x, z, up = own @ along, own @ aside, -own[:, 1]
            far = np.stack([np.abs(x) - size[0] / 2, np.abs(z) - size[1] / 2, up - size[2], -up - 0.05], axis=1)
            inside = (far.max(axis=1) < 0.1) & (instance > 0)
            if inside.sum() < 10:
                continue
            owner = np.bincount(instance[inside]).argmax()
            assert np.mean(far.max(axis=1)[instance == owner] < 0.1) > 0.97
            checked += 1
    assert checked >= 10


def test_boxes_follow_kitti_s_conventions(frames: list[Frame]) -> None:
    for frame in frames:
        boxes = frame.boxes
        assert set(boxes.kind) <= {"Car", "Van", "Truck", "Pedestrian", "Cyclist"}
        left, top, right, bottom = boxes.bbox_px.T
        assert ((left >= 0) & (left < right) & (right <= SIZE[1] - 1)).all()
        assert ((top >= 0) & (top < bottom) & (bottom <= SIZE[0] - 1)).all()
        assert ((boxes.truncated >= 0) & (boxes.truncated <= 1)).all()
        assert set(boxes.occluded.tolist()) <= {0, 1, 2}
        assert (np.abs(boxes.yaw_rad) <= np.pi).all()
        assert (boxes.centre_m[:, 2] > 0).all()


def test_what_comes_back_depends_on_material_and_range(world: SyntheticWorld, truths: list[Truth]) -> None:
    images = [world.measure(i, t) for i, t in zip((0, 4, BUSY, 9, 13), truths, strict=True)]
    came = np.stack([image.valid for image in images])
    met = np.stack([t.image.valid for t in truths])
    range_m = np.stack([t.image.range_m for t in truths])
    glass = np.stack([t.scan.glass for t in truths]) & met
    road = np.stack([t.scan.semantic == 7 for t in truths]) & met
    retro = np.stack([t.scan.retro & (t.scan.incidence_rad < 0.8) for t in truths]) & came
    assert 0.80 < came.sum() / met.sum() < 0.97
    assert 0.05 < came[glass].mean() < 0.45
    assert came[road & (range_m < 15)].mean() > 0.97
    assert came[road & (range_m > 60)].mean() < 0.5
    assert not came[~met].any()
    assert np.stack([image.intensity for image in images])[retro].min() > 0.98


def test_noise_is_about_the_real_sensor_s(world: SyntheticWorld, truths: list[Truth]) -> None:
    truth = truths[2]
    one, other = (world.measure(BUSY, truth, repeat=k) for k in (0, 1))
    both = one.valid & other.valid
    assert not np.array_equal(one.valid, other.valid)
    # KITTI's own scans repeat within 0.025 to 0.031 (see the figures with the sample data).
    assert 0.015 < np.abs(one.intensity - other.intensity)[both].mean() < 0.035
    spread = (one.range_m - truth.image.range_m)[one.valid].std()
    assert spread == pytest.approx(world.sensor.range_noise_m, rel=0.1)


def test_the_noise_floor_lies_far_below_the_per_class_mean(world: SyntheticWorld, truths: list[Truth]) -> None:
    truth_error, class_error = [], []
    for i, truth in zip((0, 4, BUSY, 9, 13), truths, strict=True):
        image = world.measure(i, truth)
        intensity, semantic = image.intensity[image.valid], truth.scan.semantic[image.valid]
        mean = np.array([intensity[semantic == k].mean() if (semantic == k).any() else 0.0 for k in range(34)])
        class_error.append(np.abs(intensity - mean[semantic]).mean())
        truth_error.append(np.abs(intensity - truth.image.intensity[image.valid]).mean())
    assert np.mean(truth_error) / np.mean(class_error) < 0.30


def test_beam_gains_belong_to_the_sensor(truths: list[Truth]) -> None:
    sensor = TrueSensor()
    gain = beam_gain(sensor, 64)
    np.testing.assert_array_equal(gain, beam_gain(sensor, 64))
    assert 0.25 < gain.std() / gain.mean() < 0.37
    # The same surface in neighbouring lines differs by the ratio of the gains.
    road = (truths[2].scan.semantic == 7) & truths[2].image.valid & (truths[2].scan.range_m < 20)
    rows = [r for r in range(30, 64) if road[r].sum() > 50]
    seen = np.array([truths[2].image.intensity[r][road[r]].mean() for r in rows])
    assert np.corrcoef(seen, gain[rows])[0, 1] > 0.9


def test_colour_tells_part_of_the_reflectance(world: SyntheticWorld, frames: list[Frame], truths: list[Truth]) -> None:
    """Within a class, what is bright to the eye tends to be bright at 905 nm, markings and walls above all."""
    pairs: dict[int, list] = {7: [], 11: [], 26: []}
    for frame, truth in zip(frames, truths, strict=True):
        measured = world.measure(int(frame.name[-6:]), truth).valid
        _, winner = points_to_polar(frame.cloud, world.grid)
        index = np.asarray(winner)[measured]
        uv, depth = (np.asarray(v) for v in project(frame.camera.camera, frame.cloud.xyz_m))
        (uv, depth), nir = (v[index] for v in (uv, depth)), truth.scan.reflectance[measured]
        seen = depth > 1.0
        seen[seen] = ((uv[seen] >= 0) & (uv[seen] <= np.array(SIZE[::-1]) - 1)).all(axis=1)
        u, v = np.round(uv[seen]).astype(int).T
        grey = frame.camera.rgb[v, u].mean(axis=-1)
        for kind, found in pairs.items():
            own = (frame.camera.semantic[v, u] == kind) & (truth.scan.semantic[measured][seen] == kind)
            found.append(np.stack([grey[own], nir[seen][own]]))
    for kind, found in pairs.items():
        together = np.corrcoef(np.concatenate(found, axis=1))[0, 1]
        assert 0.25 < together < 0.95, kind


@pytest.mark.long
def test_another_sensor_sees_the_same_world() -> None:
    world = SyntheticWorld(seed=1, spec=preset("vlp16"), columns=300, image_size=SIZE)
    truth = world.truth(BUSY)
    assert truth.image.range_m.shape == (16, 300)
    assert truth.image.valid.mean() > 0.4


def test_a_smaller_image_keeps_the_view() -> None:
    whole, half = kitti_camera(), kitti_camera(SIZE)
    points = np.array([[8.0, 2.0, -1.0], [20.0, -9.0, 1.0]], np.float32)
    (big, _), (small, _) = (project(camera, points) for camera in (whole, half))
    scale = np.array([621 / 1242, 188 / 375])
    np.testing.assert_allclose((np.asarray(big) + 0.5) * scale, np.asarray(small) + 0.5, atol=0.01)
