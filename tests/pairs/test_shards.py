"""A note of a file of records is what was written, or the file is made anew."""

import json

import pytest

from jaxsim.data import open_dataset
from jaxsim.data.tfds_builder import Shard
from jaxsim.pairs.shards import PairJob, make_all, read_note
from tests.data.made_prepared_set import PREPARE, kitti

RIGHT = {
    "bytes": 3,
    "names": ["a"],
    "scenes": ["x"],
    "windows": [[4, 8]],
    "labelled": [True],
    "pictured": [True],
    "sources": [""],
}


@pytest.mark.parametrize(
    "change",
    [
        {"scenes": [1e30]},
        {"names": [None]},
        {"labelled": [1]},
        {"pictured": []},
        {"windows": [[4, 0]]},
        {"sources": [0]},
    ],
)
def test_a_note_whose_columns_are_none_is_refused(tmp_path, change):
    shard = Shard("train", 0, 1, (0,))
    shard.file(tmp_path).write_bytes(b"abc")
    (tmp_path / "done").mkdir()
    note = tmp_path / "done" / f"{shard.file(tmp_path).name}.json"
    note.write_text(json.dumps(RIGHT))
    assert read_note(shard, tmp_path) == RIGHT
    note.write_text(json.dumps(RIGHT | change))
    with pytest.raises(ValueError, match="does not tell of the 1 pairs"):
        read_note(shard, tmp_path)


@pytest.mark.slow  # tests/cli/test_prepare.py shows as much on its way
def test_many_processes_make_the_records_that_one_makes_in_order(raw_root):
    job = PairJob(kitti(raw_root), PREPARE, open_dataset(kitti(raw_root)).spec, scan=True)
    positions = [2, 0, 1, 0, 2] * 3
    assert list(make_all(job, positions, workers=2)) == list(make_all(job, positions, workers=1))
