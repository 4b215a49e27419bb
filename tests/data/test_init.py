"""Data sets by their kind."""

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


def test_a_folder_beside_a_config_is_the_one_that_is_read(tmp_path):
    with pytest.raises(ValueError, match=rf"kitti: no date folder: {tmp_path} holds nothing"):
        open_dataset(DataConfig(kind="kitti_raw", root=tmp_path / "other"), tmp_path)


def test_a_folder_that_nothing_is_read_from_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"kind synthetic reads no files.*--data\.kind, of kitti_raw, .*prepared\)"):
        open_dataset(DataConfig(kind="synthetic", root=tmp_path))


def test_scenes_of_a_kind_that_has_none_to_choose_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"kitti_raw takes no scenes \(drive_0001\): leave --data\.scenes out"):
        open_dataset(DataConfig(kind="kitti_raw", root=tmp_path, scenes=("drive_0001",)))


def test_an_unknown_kind_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="must be one of synthetic, kitti_raw, kitti_object"):
        DataConfig(kind="waymo")  # pyright: ignore[reportArgumentType]
