"""A sensor over days: what was put in is found and nothing else is."""

import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.discover.watch import SECTORS, changes, measures, questions, watch_days
from jaxsim.frame import PolarGrid, PolarImage

ROWS, COLUMNS, SCENES = 8, 96, 10
GRID = PolarGrid(
    (np.pi - (np.arange(COLUMNS) + 0.5) * 2 * np.pi / COLUMNS).astype("f4"),
    np.linspace(0.1, -0.3, ROWS).astype("f4"),
    np.zeros(ROWS, "f4"),
)


def drives(seed, change=lambda intensity, valid: (intensity, valid)):
    """Ten drives through streets of their own brightness and openness, three frames each: (scene, frame) and image."""
    rng = np.random.default_rng(seed)
    for scene in range(SCENES):
        bright, full = rng.uniform(0.2, 0.5), rng.uniform(0.6, 0.95)
        for k in range(3):
            intensity = bright * np.exp(rng.normal(0, 0.2, (ROWS, COLUMNS)))
            intensity, valid = change(intensity, rng.random((ROWS, COLUMNS)) < full)
            range_m = np.where(valid, 20, 0).astype("f4")
            yield scene, k, PolarImage(range_m, np.clip(intensity, 0, 1).astype("f4"), np.asarray(valid))


def day(folder, seed, *change):
    about = {}
    for scene, k, image in drives(seed, *change):
        name = f"{scene:02d}-{k}"
        about[name] = {"scene": f"drive{scene}"}
        write_frame(folder, name, image)
    write_grid(folder, GRID, frames=about)
    return folder


def table(seed):
    """What a folder of `day` is asked, without its files."""
    return np.array([measures(image) for _, _, image in drives(seed)]).reshape(SCENES, 3, -1).mean(1)


def dying_beam(intensity, valid):
    intensity[3] *= 0.7
    return intensity, valid


def dirty_window(intensity, valid):
    width = COLUMNS // SECTORS
    intensity[:, 5 * width : 6 * width] *= 0.75
    valid[:, 5 * width : 6 * width] &= np.random.default_rng(9).random((ROWS, width)) < 0.6
    return intensity, valid


def test_a_dying_beam_and_dirt_are_found_where_they_are_and_nothing_else(tmp_path):
    monday = day(tmp_path / "monday", 0)
    days = watch_days(monday, [day(tmp_path / "beam", 2, dying_beam), day(tmp_path / "dirt", 3, dirty_window)])
    beam, dirt = ({(c.what.split(" (")[0], c.channel) for c in one.changes} for one in days)
    assert beam == {("row 3", "intensity")}
    assert {("sector 5", "intensity"), ("sector 5", "returns")} <= dirt
    (change,) = days[0].changes
    assert change.low < np.log(0.7) < change.high


def test_unchanged_days_seldom_show_a_change():
    names = questions(GRID)
    shown = [bool(changes(table(2 * k), table(2 * k + 1), names)) for k in range(40)]
    # One in twenty is what is promised; seven of forty would come once in two hundred times.
    assert sum(shown) < 7


def test_the_command_prints_a_table_over_days_and_ends_with_one(tmp_path, capsys):
    monday, beam = day(tmp_path / "monday", 0), day(tmp_path / "beam", 2, dying_beam)
    with pytest.raises(SystemExit) as stop:
        main(["watch", str(monday), "--days", str(beam), "--out", str(tmp_path / "table.md")])
    assert stop.value.code == 1
    assert "| row 3, intensity | -30.3 % (-31.9 .. -28.7) |" in (tmp_path / "table.md").read_text()
    assert "| row 3, intensity | -30.3 % (-31.9 .. -28.7) |" in capsys.readouterr().out


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


def test_a_day_alone_cannot_be_watched(tmp_path):
    with pytest.raises(SystemExit, match="--days names no folder"):
        main(["watch", str(tmp_path), "--days"])
