import shutil
from dataclasses import replace

import numpy as np
import pytest

from jaxsim.data import KittiObject
from jaxsim.detect.batches import SceneBatches, in_box
from jaxsim.detect.scenes import Scenes, cached_scenes, check_detectable, read_scene, scene_of_frame, write_scene
from jaxsim.train.training import ahead
from tests.detect.tiny import EXPERIMENT, VOXELS, scene

AUGMENT = replace(EXPERIMENT.augment, sampled=4, flip=0.5, rotation_rad=0.5, scaling=(0.9, 1.1))


def test_the_camera_sees_the_published_points(kitti, scan):
    points, seen = scan
    found = scene_of_frame(kitti[1], "Car", in_image=True)
    assert abs(len(found.points) - seen.sum()) <= 2
    np.testing.assert_array_equal(found.points[:500], points[seen][:500].astype(np.float32))


def test_cars_of_a_real_frame_hold_their_points(kitti):
    found = scene_of_frame(kitti[1], "Car", in_image=False)
    assert [kind for kind in found.labels.kind if kind == "Car"] == ["Car"] * int(found.target.sum())
    for box in found.boxes[found.target]:
        inside = found.points[in_box(found.points, box)]
        assert len(inside) > 3
        # The road is not in the box: what is inside lies above its bottom, and reaches up.
        assert inside[:, 2].max() - inside[:, 2].min() > 0.3


def test_a_scene_is_read_as_it_was_kept(tmp_path, kitti):
    made = scene_of_frame(kitti[0], "Pedestrian", in_image=True)
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

        def name_of(self, i):
            return kitti.name_of(i)

    for settings in ("a", "a", "b"):
        scenes = cached_scenes(Counting(), [2], "Car", in_image=True, cache=tmp_path, settings=settings)
        assert isinstance(scenes, Scenes)
        assert scenes[0].name == "000002"
    assert made == [2, 2]


def test_a_frame_that_is_added_moves_no_scene_that_is_kept(tmp_path, kitti):
    class Later:
        """The data set without its first frame: positions are one less."""

        def __getitem__(self, i):
            return kitti[i + 1]

        def name_of(self, i):
            return kitti.name_of(i + 1)

    kept = [cached_scenes(of, [1], "Car", in_image=True, cache=tmp_path, settings="a")[0] for of in (Later(), kitti)]
    assert [scene.name for scene in kept] == ["000002", "000001"]


def test_a_scene_of_files_that_have_changed_is_made_anew_and_no_other(tmp_path, samples):
    root = tmp_path / "object"
    shutil.copytree(samples / "kitti_object" / "training", root / "training", copy_function=shutil.copy)

    def kept():
        return cached_scenes(
            KittiObject(root), [0, 1], "Car", in_image=True, cache=tmp_path / "cache", settings="a"
        ).files

    before = kept()
    assert kept() == before
    label = root / "training" / "label_2" / "000001.txt"
    label.write_text(
        label.read_text() + "DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10\n"
    )
    after = kept()
    assert (after[0], after[1] != before[1]) == (before[0], True)
    assert len(read_scene(after[1]).labels.kind) == len(read_scene(before[1]).labels.kind) + 1


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
        check_detectable(points, "frame")


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


def test_processes_share_a_batch():
    whole, parts = loader()[3], [loader(part=i, parts=2)[3] for i in range(2)]
    np.testing.assert_array_equal(whole["points"], np.concatenate([part["points"] for part in parts]))
