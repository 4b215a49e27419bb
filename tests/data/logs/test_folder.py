"""A log becomes a folder once: what is there stays, and another log's frames are kept out."""

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, Source, write_log
from jaxsim.data.logs.gridding import FIRST
from jaxsim.data.logs.scan import Item, scan_of_fields
from jaxsim.data.polar_frames import frame_names, read_grid
from tests.data.logs.conftest import ELEVATION, FIRINGS, RINGS, expected, room
from tests.data.logs.made_logs import carla_buffer, frames_of

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


def test_frames_that_no_log_json_tells_of_are_not_written_over(tmp_path):
    log, out = tmp_path / "log", tmp_path / "out"
    log.mkdir()
    write_log(log, "made", log_of(1, read=[]), out=out, options=OPTIONS)
    (out / "log.json").unlink()
    before = (out / "000000.npz").stat().st_mtime_ns
    with pytest.raises(
        ValueError, match=r"out is not empty, and no log\.json says what it was made with; give another"
    ):
        write_log(log, "made", log_of(1, read=[]), out=out, options=OPTIONS)
    assert (out / "000000.npz").stat().st_mtime_ns == before


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


def test_a_scan_that_is_no_whole_turn_any_more_leaves_no_frame(tmp_path):
    log, out = tmp_path / "log", tmp_path / "out"
    log.mkdir()
    files = [log / f"{k}.scan" for k in range(FIRST + 1)]
    for file in files:
        file.write_bytes(b"1")

    def written(last: float):
        source = log_of(*[1] * FIRST, last, read=[])
        items = [item._replace(files=(file,)) for item, file in zip(source.items(log, OPTIONS), files, strict=True)]
        return write_log(log, "made", source._replace(items=lambda *_: iter(items)), out=out, options=OPTIONS)

    assert written(1).frames == FIRST + 1
    files[-1].write_bytes(b"12")
    assert written(0.2).partial == 1
    assert list(frame_names(out)) == list(read_grid(out)[1]) == [f"{k:06d}" for k in range(FIRST)]


def test_two_scans_of_one_name_are_refused(tmp_path):
    source = log_of(1, 1, read=[])
    items = [item._replace(name="same") for item in source.items(tmp_path, OPTIONS)]
    with pytest.raises(ValueError, match=r"made: .*log holds two scans of the name same, .*the folder of each"):
        write_log(
            tmp_path / "log", "made", source._replace(items=lambda *_: items), out=tmp_path / "out", options=OPTIONS
        )


@pytest.mark.parametrize(("rings", "rows"), [("8-15", slice(8, 16)), ("0-3", slice(0, 4)), ("14-99", slice(14, 16))])
def test_rings_that_are_asked_for_keep_their_beams_where_these_are_known(tmp_path, fields, rings, rows):
    _, frames = frames_of(carla_buffer(tmp_path, fields, semantic=False), tmp_path / "out", rings=rings)
    image, _ = frames.read(frames.names[0])
    np.testing.assert_allclose(frames.grid.elevation_rad, ELEVATION[rows], atol=1e-6)
    np.testing.assert_allclose(image.range_m, expected(fields)[0][rows], rtol=1e-5)
    with pytest.raises(ValueError, match=r"--log\.rings is '15', one beam of 000010; give two or more"):
        frames_of(tmp_path, tmp_path / "one", rings="15")
