"""Scenes as training batches: pasted cars, augmentation, room for points."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.detect.batches import SceneBatches, augment_scene, collide, cutouts, heights_on, in_box, pad_scene, paste
from jaxsim.geometry.boxes import iou_bev, points_in_boxes
from tests.detect.tiny import EXPERIMENT, VIEW, VOXELS, scene

AUGMENT = replace(EXPERIMENT.augment, sampled=4, flip=0.5, rotation_rad=0.5, scaling=(0.9, 1.1))


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
        after = augment_scene(before, [], config, rng=np.random.default_rng(seed))
        slack = after.boxes * np.float32([1, 1, 1, 1.0001, 1.0001, 1.0001, 1])
        assert [in_box(after.points, box).sum() for box in slack] == held
        assert (np.abs(after.boxes[:, 6]) <= np.pi).all()
    assert not np.array_equal(after.points, before.points)
    still = replace(config, flip=0.0, rotation_rad=0.0, scaling=(1.0, 1.0))
    same = augment_scene(before, [], still, rng=np.random.default_rng(0))
    np.testing.assert_allclose(same.boxes, before.boxes, atol=1e-6)
    mirrored = augment_scene(before, [], replace(still, flip=1.0), rng=np.random.default_rng(0))
    np.testing.assert_allclose(mirrored.boxes[:, [1, 6]], -before.boxes[:, [1, 6]], atol=1e-6)


def test_an_epoch_shows_every_scene_once():
    plain = replace(EXPERIMENT.augment, sampled=0)
    batches = SceneBatches([scene(k, cars=k + 1) for k in range(6)], VOXELS, plain, size=2, seed=0)
    assert batches.steps_per_epoch == 3
    for epoch in (0, 1):
        counts = np.concatenate([batches[k]["is_object"].sum(axis=1) for k in range(3 * epoch, 3 * epoch + 3)])
        assert sorted(counts) == [1, 2, 3, 4, 5, 6]


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
