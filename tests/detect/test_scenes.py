from dataclasses import replace

import numpy as np
import pytest

from jaxsim.data import KittiObject
from jaxsim.detect.batches import SceneBatches, augment, collide, cutouts, heights_on, in_box, pad_scene, paste
from jaxsim.detect.results import Found, corners_of, label_lines, outlines, result_lines
from jaxsim.detect.scenes import Scenes, check_points, kept_scenes, read_scene, scene_of, write_scene
from jaxsim.geometry.boxes import box_corners, iou_bev, points_in_boxes
from jaxsim.train.training import ahead
from tests.detect.tiny import EXPERIMENT, VIEW, VOXELS, scene

AUGMENT = replace(EXPERIMENT.augment, sampled=4, flip=0.5, rotation_rad=0.5, scaling=(0.9, 1.1))


@pytest.fixture(scope="module")
def kitti(samples):
    return KittiObject(samples / "kitti_object")


def test_the_camera_sees_the_published_points(kitti, scan):
    points, seen = scan
    found = scene_of(kitti[1], "Car", in_image=True)
    assert abs(len(found.points) - seen.sum()) <= 2
    np.testing.assert_array_equal(found.points[:500], points[seen][:500].astype(np.float32))


def test_cars_of_a_real_frame_hold_their_points(kitti):
    found = scene_of(kitti[1], "Car", in_image=False)
    assert [kind for kind in found.labels.kind if kind == "Car"] == ["Car"] * int(found.target.sum())
    for box in found.boxes[found.target]:
        inside = found.points[in_box(found.points, box)]
        assert len(inside) > 3
        # The road is not in the box: what is inside lies above its bottom, and reaches up.
        assert inside[:, 2].max() - inside[:, 2].min() > 0.3


def test_a_scene_is_read_as_it_was_kept(tmp_path, kitti):
    made = scene_of(kitti[0], "Pedestrian", in_image=True)
    write_scene(tmp_path / "one.npz", made)
    read = read_scene(tmp_path / "one.npz")
    for name in ("points", "boxes", "target", "difficulty"):
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
    assert (read.name, read.labels.kind, read.view.size) == (made.name, made.labels.kind, made.view.size)
    np.testing.assert_array_equal(read.view.rect_from_velo, made.view.rect_from_velo)


def test_kept_scenes_are_made_once_and_other_settings_apart(tmp_path, kitti):
    made = []

    class Counting:
        def __getitem__(self, i):
            made.append(i)
            return kitti[i]

    for settings in ("a", "a", "b"):
        scenes = kept_scenes(Counting(), [2], "Car", in_image=True, cache=tmp_path, settings=settings)
        assert isinstance(scenes, Scenes)
        assert scenes[0].name == "000002"
    assert made == [2, 2]


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 4)), "no points"),
        (np.zeros((5, 3)), "no intensity"),
        (np.full((5, 4), np.nan), "5 of 5 points .* NaN"),
        (np.full((5, 4), 30.0), "must lie in 0..1"),
    ],
)
def test_a_broken_cloud_is_refused(points, message):
    with pytest.raises(ValueError, match=message):
        check_points(points, "frame")


def test_result_lines_are_the_labels_of_the_same_boxes(kitti):
    found = scene_of(kitti[2], "Car", in_image=True)
    lines = result_lines(Found(found.boxes[found.target], np.array([0.75], np.float32)), "Car", found.view)
    label = next(line for line in label_lines(found.labels) if line.startswith("Car "))
    (result,) = (line.split() for line in lines)
    wanted = label.split()
    assert result[0] == "Car"
    assert result[1:3] == ["-1", "-1"]
    assert result[15] == "0.7500"
    np.testing.assert_allclose(np.float64(result[8:15]), np.float64(wanted[8:]), atol=2e-3)
    np.testing.assert_allclose(float(result[3]), float(wanted[3]), atol=2e-2)
    np.testing.assert_allclose(np.float64(result[4:8]), np.float64(wanted[4:8]), atol=4)  # drawn by hand


def test_corners_are_those_of_the_kernel():
    boxes = np.random.default_rng(0).uniform(1, 4, (9, 7)).astype(np.float32)
    np.testing.assert_allclose(corners_of(boxes), box_corners(boxes), atol=1e-5)


def test_a_box_behind_the_camera_has_a_finite_outline():
    boxes = np.array([[-5.0, 0, 0, 4, 2, 1.5, 0], [1.0, 0, -1, 4, 2, 1.5, 0.3]])
    assert np.isfinite(outlines(boxes, VIEW)).all()
    assert outlines(np.zeros((0, 7)), VIEW).shape == (0, 4)


def test_collisions_are_overlaps_above_zero():
    rng = np.random.default_rng(1)
    a, b = (np.c_[rng.uniform(0, 12, (40, 3)), rng.uniform(0.5, 5, (40, 3)), rng.uniform(-4, 4, 40)] for _ in range(2))
    overlap = np.asarray(iou_bev(a.astype(np.float32), b.astype(np.float32)))
    clear = (overlap == 0) | (overlap > 1e-4)
    np.testing.assert_array_equal(collide(a, b)[clear], overlap[clear] > 0)
    assert collide(a, a).diagonal().all()
    assert collide(a, b[:0]).shape == (40, 0)


def test_points_in_a_box_are_those_of_the_kernel():
    rng = np.random.default_rng(2)
    points, box = rng.uniform(-3, 3, (500, 3)).astype(np.float32), np.float32([0.3, -0.2, 0.1, 4, 2, 1.5, 0.8])
    np.testing.assert_array_equal(in_box(points, box), points_in_boxes(points, box[None])[:, 0])


def test_pasted_cars_are_free_and_hold_their_own_points_alone():
    scenes = [scene(k) for k in range(4)]
    database = cutouts(scenes[1:], AUGMENT)
    assert len(database) == 18
    for seed in range(6):
        after = paste(scenes[0], database, AUGMENT, rng=np.random.default_rng(seed))
        new = after.boxes[6:]
        assert len(new) <= 4
        assert not collide(new, scenes[0].boxes).any()
        assert after.target.all()
        for box in new:
            own = next(c for c in database if np.array_equal(c.box, box))
            inside = after.points[in_box(after.points, box)]
            np.testing.assert_array_equal(np.sort(inside, axis=0), np.sort(own.points, axis=0))


def test_pasted_cars_stand_on_the_road_plane():
    scenes, config = [scene(k) for k in range(3)], replace(AUGMENT, on_ground=True)
    database = cutouts(scenes[1:], config)
    with pytest.raises(ValueError, match="no road plane"):
        paste(scenes[0], database, config, rng=np.random.default_rng(0))
    ground = np.array([0.0, -1.0, 0.02, 1.5])  # camera: y = 0.02 z + 1.5
    after = paste(replace(scenes[0], ground=ground), database, config, rng=np.random.default_rng(0))
    new = after.boxes[6:]
    assert len(new)
    np.testing.assert_allclose(new[:, 2] - new[:, 5] / 2, -(0.02 * new[:, 0] + 1.5), atol=1e-4)
    np.testing.assert_allclose(heights_on(ground, new, VIEW), -(0.02 * new[:, 0] + 1.5), atol=1e-4)


def test_augmentation_moves_points_and_boxes_together():
    before, config = scene(0), replace(AUGMENT, sampled=0)
    held = [in_box(before.points, box).sum() for box in before.boxes]
    for seed in range(8):
        after = augment(before, [], config, rng=np.random.default_rng(seed))
        slack = after.boxes * np.float32([1, 1, 1, 1.0001, 1.0001, 1.0001, 1])
        assert [in_box(after.points, box).sum() for box in slack] == held
        assert (np.abs(after.boxes[:, 6]) <= np.pi).all()
    assert not np.array_equal(after.points, before.points)
    still = replace(config, flip=0.0, rotation_rad=0.0, scaling=(1.0, 1.0))
    same = augment(before, [], still, rng=np.random.default_rng(0))
    np.testing.assert_allclose(same.boxes, before.boxes, atol=1e-6)
    mirrored = augment(before, [], replace(still, flip=1.0), rng=np.random.default_rng(0))
    np.testing.assert_allclose(mirrored.boxes[:, [1, 6]], -before.boxes[:, [1, 6]], atol=1e-6)


def loader(**changes):
    options = {"size": 2, "seed": 3} | changes
    return SceneBatches([scene(k) for k in range(5)], VOXELS, AUGMENT, **options)


def test_batch_k_depends_on_seed_and_k_alone():
    one, two = loader(), loader()
    one[7], two[2]
    for name, array in one[4].items():
        np.testing.assert_array_equal(array, two[4][name])
    assert not np.array_equal(one[4]["points"], loader(seed=4)[4]["points"])
    for k, batch in enumerate(ahead(one, 2, 6), 2):
        np.testing.assert_array_equal(batch["points"], two[k]["points"])
    assert k == 5


def test_an_epoch_shows_every_scene_once():
    plain = replace(EXPERIMENT.augment, sampled=0)
    batches = SceneBatches([scene(k, cars=k + 1) for k in range(6)], VOXELS, plain, size=2, seed=0)
    assert batches.steps_per_epoch == 3
    for epoch in (0, 1):
        counts = np.concatenate([batches[k]["is_object"].sum(axis=1) for k in range(3 * epoch, 3 * epoch + 3)])
        assert sorted(counts) == [1, 2, 3, 4, 5, 6]


def test_processes_share_a_batch():
    whole, parts = loader()[3], [loader(part=i, parts=2)[3] for i in range(2)]
    np.testing.assert_array_equal(whole["points"], np.concatenate([part["points"] for part in parts]))


def test_points_beyond_the_room_are_counted():
    tight = replace(VOXELS, max_points=1000)
    made = scene(0)
    item = pad_scene(made.points, made.boxes, tight, room=9, rng=np.random.default_rng(0))
    assert item["valid"].all()
    assert item["dropped_points"] == len(made.points) - 1000


def test_scenes_without_a_car_are_refused():
    empty = replace(scene(0), target=np.zeros(6, bool))
    with pytest.raises(ValueError, match="no training scene holds an object"):
        SceneBatches([empty, empty], VOXELS, EXPERIMENT.augment, size=2, seed=0)
    with pytest.raises(ValueError, match="cannot fill a batch"):
        SceneBatches([empty], VOXELS, EXPERIMENT.augment, size=2, seed=0)
