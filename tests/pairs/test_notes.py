"""A note of a file of records is what was written, or the file is made anew."""

import json

import pytest

from jaxsim.data.tfds_builder import Shard
from jaxsim.pairs.shards import read_note

RIGHT = {"bytes": 3, "names": ["a"], "scenes": ["x"], "windows": [[4, 8]], "labelled": [True]}


@pytest.mark.parametrize("change", [{"scenes": [1e30]}, {"names": [None]}, {"labelled": [1]}, {"windows": [[4, 0]]}])
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
