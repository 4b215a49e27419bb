"""Prepared pairs as a data set of TFDS."""

from pathlib import Path

import numpy as np
import pytest

from jaxsim.data.tfds_builder import Shard, shards_of, write_records
from tests.full_disk import no_file_above


def test_files_are_cut_so_that_the_last_takes_what_is_left():
    shards = shards_of({"train": list(range(5)), "eval": [7]}, 2)
    assert [shard.positions for shard in shards] == [(0, 1), (2, 3), (4,), (7,)]
    assert shards[2] == Shard("train", 2, 3, (4,))
    assert shards[2].file(Path("a")).name == "jaxsim_pairs-train.array_record-00002-of-00003"


def test_a_disk_without_room_for_records_is_told_and_leaves_nothing(tmp_path):
    noise = np.random.default_rng(0).bytes(50_000)
    with no_file_above(10_000), pytest.raises(OSError, match=r"a file of records cannot be written .*make room"):
        write_records(tmp_path / "x.array_record-00000-of-00001", [noise])
    assert not [*tmp_path.iterdir()]
