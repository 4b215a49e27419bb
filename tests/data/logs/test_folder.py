"""A log becomes a folder once: what is there stays, and another log's frames are kept out."""

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, Source, write_log
from jaxsim.data.logs.scan import Item, scan_of_fields
from jaxsim.data.polar_frames import frame_names
from tests.data.logs.conftest import FIRINGS, RINGS, room

OPTIONS = LogOptions()


def log_of(*turns: float, read: list[int]) -> Source:
    """A source of as many turns, of which each has a share of its firings; `read` gets the numbers that are read."""

    def scan(number: int):
        read.append(number)
        whole = np.arange(FIRINGS * RINGS) < round(turns[number] * FIRINGS) * RINGS
        fields = {name: values[whole] for name, values in room(number).items()}
        return scan_of_fields(fields, OPTIONS, by="made", where="here", name=f"{number:06d}", scene="room")

    items = [Item(f"{number:06d}", lambda number=number: scan(number)) for number in range(len(turns))]
    return Source("made", lambda path: True, lambda path, options: iter(items))


def test_whole_turns_are_written_once_and_the_command_goes_on(tmp_path):
    read: list[int] = []
    log, out = tmp_path / "log", tmp_path / "out"
    log.mkdir()
    first = write_log(log, "made", log_of(1, 0.2, 1, read=read), out=out, options=OPTIONS)
    assert (first.frames, first.already, first.partial, first.rows, first.columns) == (2, 0, 1, RINGS, FIRINGS)
    assert first.filled == 1
    (out / "000002.npz").unlink()
    read.clear()
    again = write_log(log, "made", log_of(1, 0.2, 1, read=read), out=out, options=OPTIONS)
    assert (again.frames, again.already) == (1, 1)
    # The sensor is that of log.json: no scan is read for it.
    assert read == [1, 2]
    assert list(frame_names(out)) == ["000000", "000002"]


def test_other_options_are_kept_out_and_an_empty_log_is_told(tmp_path):
    log, out = tmp_path / "log", tmp_path / "out"
    log.mkdir()
    write_log(log, "made", log_of(1, read=[]), out=out, options=OPTIONS)
    with pytest.raises(ValueError, match="returns"):
        write_log(log, "made", log_of(1, read=[]), out=out, options=LogOptions(returns="last"))
    with pytest.raises(ValueError, match=r"made: .*log holds no scan"):
        write_log(log, "made", log_of(read=[]), out=tmp_path / "other", options=OPTIONS)
