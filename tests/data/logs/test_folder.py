"""A log becomes a folder once: what is there stays, and another log's frames are kept out."""

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, Source, write_log
from jaxsim.data.logs.gridding import FIRST
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


def test_scans_of_changed_files_and_frames_that_are_cut_off_are_made_anew(tmp_path, caplog):
    log, out = tmp_path / "log", tmp_path / "out"
    log.mkdir()
    files = [log / f"{k}.scan" for k in range(FIRST + 2)]
    for file in files:
        file.write_bytes(b"1")

    def written() -> tuple[int, int]:
        source = log_of(*[1] * len(files), read=[])
        items = [item._replace(files=(file,)) for item, file in zip(source.items(log, OPTIONS), files, strict=True)]
        made = write_log(log, "made", source._replace(items=lambda *_: iter(items)), out=out, options=OPTIONS)
        return made.frames, made.already

    assert (written(), written()) == ((FIRST + 2, 0), (0, FIRST + 2))
    files[-1].write_bytes(b"12")
    assert (written(), written()) == ((1, FIRST + 1), (0, FIRST + 2))
    cut = out / "000001.npz"
    cut.write_bytes(cut.read_bytes()[:-100])
    assert (written(), written()) == ((1, FIRST + 1), (0, FIRST + 2))
    assert "frames: 000001 made anew: its file is cut off or damaged" in caplog.text
    # The sensor of all frames was told from the first scans.
    files[1].write_bytes(b"12")
    with pytest.raises(
        ValueError, match=r"out holds 000001, and what it was made of has changed since.*delete the fold"
    ):
        written()
