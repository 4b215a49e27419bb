"""KITTI's benchmarks as one data set, and the object benchmark's `testing`."""

import re
import shutil

import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import KittiObject, open_dataset, select
from jaxsim.pairs.prepared import prepared

SMALL = PrepareConfig(inputs=("rgb", "depth", "row"), depth="ip_basic_fast", columns=64, network_size=(44, 64))


@pytest.fixture
def with_testing(object_root):
    """One frame of the same number in both parts; that of `testing` without labels."""
    shutil.copytree(object_root / "training", object_root / "testing")
    shutil.rmtree(object_root / "testing/label_2")
    return object_root


def test_testing_follows_training_and_has_no_labels(with_testing):
    dataset = KittiObject(with_testing)
    assert [dataset.name_of(i) for i in range(len(dataset))] == ["000007", "testing-000007"]
    assert dataset[0].boxes is not None
    assert dataset[1].boxes is None
    assert (dataset[1].name, dataset[1].scene) == ("testing-000007",) * 2
    assert (select("training", dataset), select("testing", dataset)) == ([0], [1])


def test_lists_name_frames_of_their_own_part(with_testing):
    (with_testing / "ImageSets").mkdir()
    for name in ("val", "test"):
        (with_testing / f"ImageSets/{name}.txt").write_text("000007\n")
    dataset = KittiObject(with_testing)
    assert (select("val", dataset), select("test", dataset)) == ([0], [1])


@pytest.mark.parametrize(("numbers", "here"), [(("000007", "000008", "000009"), 1), (("000008", "000009"), 0)])
def test_a_list_of_frames_that_are_not_all_there_is_refused_with_what_is_missing(with_testing, numbers, here):
    (with_testing / "ImageSets").mkdir()
    (with_testing / "ImageSets/train.txt").write_text("\n".join(numbers))
    (with_testing / "ImageSets/val.txt").write_text("000007\n")
    together = with_testing.parent / "kitti"
    together.mkdir()
    (together / "object").symlink_to(with_testing)
    for dataset in (KittiObject(with_testing), open_dataset("kitti", together)):
        told = rf"train\.txt names {len(numbers)} frames, of which {here} have .*; training/ lacks 000008, the first\."
        for text in ("train", "train:2", "all but train"):
            with pytest.raises(ValueError, match=told):
                select(text, dataset)
        assert select("val", dataset) == [0]
        (with_testing / "ImageSets/none.txt").touch()
        with pytest.raises(ValueError, match=r"none\.txt names no frame; write one number a line"):
            select("none", dataset)


def test_a_part_without_images_does_no_harm_and_testing_alone_will_do(with_testing, caplog):
    shutil.rmtree(with_testing / "testing/image_2")
    assert len(KittiObject(with_testing)) == 1
    assert re.search(r"testing left out: kitti: there is no folder .*testing/image_2; expected", caplog.messages[0])
    shutil.rmtree(with_testing / "testing")
    (with_testing / "training").rename(with_testing / "testing")
    assert [KittiObject(with_testing).name_of(0)] == ["testing-000007"]


def test_raw_and_object_frames_are_learned_from_together(raw_root, with_testing, tmp_path):
    """Links to where each lies; an empty drive and a frame without labels are among them."""
    together = tmp_path / "kitti"
    together.mkdir()
    (together / "raw").symlink_to(raw_root)
    (together / "object").symlink_to(with_testing)
    (raw_root / "2011_09_26/2011_09_26_drive_0099_sync/velodyne_points/data").mkdir(parents=True)
    data = DataConfig(kind="kitti", root=together, cache=tmp_path / "cache")
    dataset = open_dataset(data)
    assert len(dataset) == 5
    assert {name: select(name, dataset) for name in ("raw", "object", "drive_0001", "testing")} == {
        "raw": [0, 1, 2],
        "object": [3, 4],
        "drive_0001": [0, 1],
        "testing": [4],
    }
    pairs = prepared(dataset, [2, 3, 4], data, prepare=SMALL)
    assert [pairs.record(i).name[-6:] for i in range(3)] == ["000000", "000007", "000007"]
    assert all(np.isfinite(pair.target).all() for pair in pairs)


def test_a_benchmarks_training_is_not_that_of_all(raw_root, with_testing):
    """`jaxsim prepare` would leave the drives out."""
    assert "training" in open_dataset("kitti", with_testing).splits
    (with_testing / "raw").symlink_to(raw_root)
    splits = open_dataset("kitti", with_testing).splits
    assert {"raw", "object", "testing"} <= {*splits}
    assert not {"training", "evaluation"} & {*splits}


def test_names_that_two_parts_have_are_left_out(odometry_root, object_root):
    (object_root / "sequences").symlink_to(odometry_root / "sequences")
    dataset = open_dataset("kitti", object_root)
    assert [*dataset.parts] == ["object", "odometry"]
    assert "training" not in dataset.splits  # of which of the two?
    assert select("sequence_08", dataset) == [3]
    assert dataset[3].name == "sequence_08-000000"
    assert dataset[-1].name == dataset.name_of(-1) == dataset[4].name
    with pytest.raises(IndexError, match="no frame 5; the data set has 0 to 4"):
        dataset[5]


def test_a_folder_without_any_part_says_what_is_there(tmp_path):
    (tmp_path / "images").mkdir()
    with pytest.raises(ValueError, match=r"kitti: no part of it: .* holds images/; pass the folder"):
        open_dataset("kitti", tmp_path)
    with pytest.raises(ValueError, match="kitti: there is no folder"):
        open_dataset("kitti", tmp_path / "not")
