"""Data sets by their kind."""

from inspect import unwrap
from typing import get_args

import pytest

from jaxsim.config import DataConfig
from jaxsim.config.data import DataKind
from jaxsim.data import DATASETS, open_dataset


def test_every_kind_of_the_settings_is_a_row_of_the_table():
    assert set(get_args(DataKind)) == set(DATASETS)


def test_a_data_set_that_reads_files_needs_a_root():
    with pytest.raises(ValueError, match=r"kind kitti_raw reads files; name their folder with --data\.root"):
        open_dataset(DataConfig(kind="kitti_raw"))


@pytest.mark.parametrize(
    ("inside", "kind"),
    [("2011_09_26", "kitti_raw"), ("sequences/00", "kitti_odometry"), ("Scene01", "vkitti2"), ("other", "KIND")],
)
def test_a_folder_in_the_place_of_a_kind_is_answered_with_both(tmp_path, inside, kind):
    (tmp_path / inside).mkdir(parents=True)
    with pytest.raises(ValueError, match=rf"open_dataset\('{kind}', '{tmp_path}'\); known kinds: synthetic, kitti_raw"):
        open_dataset(str(tmp_path))


@pytest.mark.parametrize("index", [1.5, "a", slice(0, 2), None])
def test_frames_of_every_kind_are_asked_for_by_number(raw_root, object_root, step_root, virtual_root, index):
    configs = [
        DataConfig(),
        DataConfig("kitti_raw", raw_root),
        DataConfig("kitti_object", object_root),
        DataConfig("kitti", raw_root),
        DataConfig("kitti_step", step_root, scenes=("0000",)),
        DataConfig("vkitti2", virtual_root, scenes=("Scene01",)),
    ]
    for dataset in map(open_dataset, configs):
        told = f"{dataset.name}: a frame is given by its number, 0 to {len(dataset) - 1}, not by "
        with pytest.raises(TypeError, match=told):
            unwrap(type(dataset).__getitem__)(dataset, index)
        with pytest.raises(IndexError):
            dataset[len(dataset)]


def test_a_folder_beside_a_config_is_the_one_that_is_read(tmp_path):
    with pytest.raises(ValueError, match=rf"kitti: no date folder: {tmp_path} holds nothing"):
        open_dataset(DataConfig(kind="kitti_raw", root=tmp_path / "other"), tmp_path)


def test_a_folder_that_nothing_is_read_from_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"kind synthetic reads no files.*--data\.kind, of kitti_raw, .*prepared\)"):
        open_dataset(DataConfig(kind="synthetic", root=tmp_path))


def test_scenes_of_a_kind_that_has_none_to_choose_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"kitti_raw takes no scenes \(drive_0001\): leave --data\.scenes out"):
        open_dataset(DataConfig(kind="kitti_raw", root=tmp_path, scenes=("drive_0001",)))


@pytest.mark.parametrize("source", [None, 3, ["kitti_raw"]])
def test_what_is_neither_a_kind_nor_a_config_is_answered_with_the_kinds(source):
    with pytest.raises(
        ValueError, match=r"open_dataset takes a kind \(synthetic, kitti_raw, .*\) or a DataConfig first"
    ):
        unwrap(open_dataset)(source)


def test_an_unknown_kind_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="must be one of synthetic, kitti_raw, kitti_object"):
        DataConfig(kind="waymo")  # pyright: ignore[reportArgumentType]
