"""Data sets by their kind."""

import pytest

from jaxsim.config import DataConfig
from jaxsim.data import open_dataset


def test_a_data_set_that_reads_files_needs_a_root():
    with pytest.raises(ValueError, match=r"kind kitti_raw reads files; name their folder with --data\.root"):
        open_dataset(DataConfig(kind="kitti_raw"))


def test_an_unknown_kind_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="must be one of synthetic, kitti_raw, kitti_object"):
        DataConfig(kind="waymo")  # pyright: ignore[reportArgumentType]
