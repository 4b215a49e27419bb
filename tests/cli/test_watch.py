"""`jaxsim watch`."""

import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.data.polar_frames import write_grid
from jaxsim.discover.watch import watch_days
from tests.discover.made_watch import GRID, day, dying_beam

ROWS, COLUMNS, SCENES = 8, 96, 10


def test_the_command_prints_a_table_over_days_and_ends_with_one(tmp_path, capsys):
    monday, beam = day(tmp_path / "monday", 0), day(tmp_path / "beam", 2, dying_beam)
    with pytest.raises(SystemExit) as stop:
        main(["watch", str(monday), "--days", str(beam), "--out", str(tmp_path / "table.md")])
    assert stop.value.code == 1
    assert "| row 3, intensity | -30.3 % (-31.5 .. -29.0) |" in (tmp_path / "table.md").read_text()
    assert "| row 3, intensity | -30.3 % (-31.5 .. -29.0) |" in capsys.readouterr().out


def test_another_sensor_and_too_few_scenes_are_refused(tmp_path):
    monday = day(tmp_path / "monday", 0)
    other = day(tmp_path / "other", 1)
    write_grid(other, GRID.replace(elevation_rad=GRID.elevation_rad + np.float32(0.01)), frames={})
    with pytest.raises(ValueError, match=r"is of another sensor than .*elevation_rad"):
        watch_days(monday, [other])
    for path in monday.glob("0[1-9]*.npz"):
        path.unlink()
    with pytest.raises(ValueError, match="monday has 1 scenes; 4 are needed"):
        watch_days(monday, [monday])


def test_days_that_cannot_be_compared_end_otherwise_than_a_change(tmp_path, capsys):
    monday = day(tmp_path / "monday", 0)
    with pytest.raises(SystemExit) as stop:
        main(["watch", str(monday), "--days", str(tmp_path / "tuesday")])
    assert stop.value.code == 2
    assert "tuesday" in capsys.readouterr().err
    # Nor is it a change that no day was named, or that the table cannot be written.
    (tmp_path / "file").touch()
    tuesday = day(tmp_path / "tuesday", 2)
    for words, message in (
        ([], "--days names no folder"),
        ([str(tuesday), "--out", str(tmp_path / "file/table.md")], "is there already, and is no folder"),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["watch", str(monday), "--days", *words])
        assert stop.value.code == 2
        assert message in capsys.readouterr().err


def test_folders_of_one_name_are_told_apart(tmp_path, capsys):
    monday = day(tmp_path / "monday/measured", 0)
    later = [day(tmp_path / f"{name}/measured", 2, dying_beam) for name in ("tuesday", "wednesday")]
    with pytest.raises(SystemExit):
        main(["watch", str(monday), "--days", *map(str, later)])
    said = capsys.readouterr().out
    assert all(f"{name}/measured (" in said for name in ("tuesday", "wednesday"))


def test_a_day_is_not_held_against_itself_nor_the_table_written_over_a_frame(tmp_path, capsys):
    monday, tuesday = day(tmp_path / "monday", 0), day(tmp_path / "tuesday", 2)
    frame = next(tuesday.glob("*.npz"))
    content = frame.read_bytes()
    for days, words, message in (
        (monday, [], "monday is held against itself"),
        (tuesday, ["--out", str(frame)], "is read, and would be written over"),
        (tuesday, ["--out", str(tmp_path)], "is a folder; name the file that the table goes to"),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["watch", str(monday), "--days", str(days), *words])
        assert stop.value.code == 2
        assert message in capsys.readouterr().err
    assert frame.read_bytes() == content
