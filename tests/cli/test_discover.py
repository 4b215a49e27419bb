"""The command, and its answers to folders that nothing can be decided from."""

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxsim.cli import COMMANDS, discover, stop_on_error
from jaxsim.data.polar_frames import frame_names, read_frame, read_grid, write_frame, write_grid
from jaxsim.discover import NO_CONTROL, Control
from jaxsim.discover.verdict import Interval, Level, Verdict
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import PolarGrid, PolarImage
from tests.report import results

ROWS, COLUMNS = 8, 48
Folders = tuple[Path, Path]


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    """Measured and simulated frames of eight drives."""
    rng = np.random.default_rng(0)
    azimuth = np.linspace(0.6, -0.6, COLUMNS).astype(np.float32)
    grid = PolarGrid(azimuth, np.linspace(0.0, -0.3, ROWS).astype(np.float32), np.zeros(ROWS, np.float32))
    measured, simulated = tmp_path / "measured", tmp_path / "simulated"
    streets_m = rng.uniform(3, 60, (8, ROWS, COLUMNS))
    for folder in (measured, simulated):
        write_grid(folder, grid)
        for k, street_m in enumerate(streets_m):
            range_m = (street_m + rng.normal(0, 0.02, street_m.shape)).astype(np.float32)
            intensity = rng.uniform(0.05, 0.9, (ROWS, COLUMNS)).astype(np.float32)
            write_frame(folder, f"drive{k}", PolarImage(range_m, intensity, range_m > 0))
    return measured, simulated


def change(folder: Path, **factors: float) -> None:
    """Multiplies a raster of every frame."""
    for name in frame_names(folder):
        image, _ = read_frame(folder, name)
        changed = {key: (getattr(image, key) * factor).astype(np.float32) for key, factor in factors.items()}
        write_frame(folder, name, image.replace(**changed))


def complaint(folders: Folders, out: Path) -> str:
    """The one line with which the command stops; it must have written nothing."""
    with pytest.raises(SystemExit) as stop, stop_on_error():
        discover.Discover(measured=folders[0], simulated=folders[1], out=out)()
    assert not out.exists()
    assert str(stop.value).startswith("error: ")
    return str(stop.value)


def test_an_answer_is_not_written_among_the_frames(folders: Folders):
    for out in folders:
        with pytest.raises(
            ValueError, match=rf"^discover: {out} is read, and would be written into; give another --out"
        ):
            discover.Discover(measured=folders[0], simulated=folders[1], out=out)()
        assert not (out / "report.html").exists()


@pytest.mark.parametrize("make", [results.named, results.none, results.not_in_catalogue])
def test_the_command_writes_its_answer(folders: Folders, tmp_path: Path, monkeypatch, capsys, make):
    seen = []

    def answer(*, simulated, measured, known, control, nulls, every_frame, log):
        seen.extend([measured, simulated, nulls])
        assert known == SensorModel()
        assert control is NO_CONTROL
        log("fitting")
        return make()

    monkeypatch.setattr("jaxsim.discover.discover_folders", answer)
    out = tmp_path / "deep" / "out"
    discover.Discover(measured=folders[0], simulated=folders[1], out=out, nulls=3)()
    assert seen == [*folders, 3]
    written = {"verdict.json", "sensor.json", "sides.json", "report.html", "figures"}
    assert {path.name for path in out.iterdir()} == written
    verdict = json.loads((out / "verdict.json").read_text())
    assert verdict["verdict"] == make().verdict.verdict
    assert SensorModel.load(out / "sensor.json", rows=results.ROWS) == make().effects_model
    printed = capsys.readouterr().out
    assert "fitting" in printed
    assert "The simulation lacks" in printed or "No missing effect" in printed


def test_a_sensor_model_of_other_beams_or_beside_unpaired(folders: Folders, tmp_path: Path):
    SensorModel((("beam_gain", {"gain": (0.1, -0.1)}),)).save(tmp_path / "sensor.json")
    given = {"measured": folders[0], "simulated": folders[1], "out": tmp_path / "out"}
    for more, words in (({}, "2"), ({"unpaired": True}, "--effects came with --unpaired")):
        with pytest.raises(SystemExit, match=words), stop_on_error():
            discover.Discover(**given, effects=tmp_path / "sensor.json", **more)()
    with pytest.raises(SystemExit, match="--nulls came with --unpaired"), stop_on_error():
        discover.Discover(**given, unpaired=True, nulls=20)()
    with pytest.raises(SystemExit, match="no file"), stop_on_error():
        discover.Discover(**given, effects=tmp_path / "other.json")()
    assert not (tmp_path / "out").exists()


def test_an_answer_is_the_control_of_the_next(folders: Folders, tmp_path: Path, monkeypatch):
    seen: list[Control] = []
    lacking = SensorModel((("range_offset", {"offset_m": 0.05}),))

    def answer(*, control, **_):
        seen.append(control)
        # Levels tell that frames were compared ray by ray.
        return dataclasses.replace(results.named(), verdict=with_levels(results.named().verdict), effects_model=lacking)

    monkeypatch.setattr("jaxsim.discover.discover_folders", answer)
    given = {"measured": folders[0], "simulated": folders[1]}
    discover.Discover(**given, out=tmp_path / "control")()
    # Elsewhere, as a folder that was moved, but for the frames.
    shutil.move(tmp_path / "control", tmp_path / "kept")
    discover.Discover(**given, out=tmp_path / "out", control=tmp_path / "kept")()
    assert seen == [NO_CONTROL, Control.load(tmp_path / "kept")]
    assert seen[1].model == lacking
    assert seen[1].folders is not None
    assert [folder.resolve() for folder in seen[1].folders] == [folders[1].resolve(), folders[0].resolve()]
    shutil.rmtree(folders[0])
    assert Control.load(tmp_path / "kept").folders is None


def test_a_control_that_is_none_or_goes_with_nothing(folders: Folders, tmp_path: Path):
    given: dict[str, Any] = {"measured": folders[0], "simulated": folders[1], "control": tmp_path}
    refused: list[tuple[dict[str, Any], str]] = [
        ({"out": tmp_path / "out"}, "no file .*verdict.json; a control is the folder of an earlier answer"),
        ({"out": tmp_path}, "is read, and would be written into"),
        ({"out": tmp_path / "out", "unpaired": True}, "--control came with --unpaired"),
        ({"out": tmp_path / "out", "fast": True, "write_gate": tmp_path / "gate.json"}, "--control came with --fast"),
    ]
    for more, words in refused:
        with pytest.raises(SystemExit, match=words), stop_on_error():
            discover.Discover(**given, **more)()
    assert not (tmp_path / "out").exists()


def with_levels(verdict: Verdict) -> Verdict:
    one = Interval(1, 0.9, 1.1, "m")
    return dataclasses.replace(verdict, levels=(Level("range_noise", one, one, one, beyond_usual=False),))


def test_the_command_is_listed():
    assert COMMANDS["discover"].load() is discover.Discover


@pytest.mark.parametrize("side", [0, 1])
def test_a_folder_that_is_not_there(folders: Folders, tmp_path: Path, side: int):
    shutil.rmtree(folders[side])
    text = complaint(folders, tmp_path / "out")
    assert ("--measured", "--simulated")[side] in text
    assert "grid.json" in text


@pytest.mark.parametrize("side", [0, 1])
def test_a_folder_without_a_grid(folders: Folders, tmp_path: Path, side: int):
    (folders[side] / "grid.json").unlink()
    text = complaint(folders, tmp_path / "out")
    assert "no grid.json" in text
    assert str(folders[side]) in text


@pytest.mark.parametrize("wrong", ["azimuth_rad", "elevation_rad"])
def test_grids_that_differ(folders: Folders, tmp_path: Path, wrong: str):
    grid, frames = read_grid(folders[0])
    write_grid(folders[0], grid.replace(**{wrong: getattr(grid, wrong) + 0.01}), frames=frames)
    text = complaint(folders, tmp_path / "out")
    assert f"differ in {wrong}" in text
    assert "simulate on the measured sensor's grid.json" in text


def test_grids_of_other_sizes(folders: Folders, tmp_path: Path):
    grid, frames = read_grid(folders[0])
    write_grid(folders[0], grid.replace(azimuth_rad=grid.azimuth_rad[1:]), frames=frames)
    assert "47" in complaint(folders, tmp_path / "out")


def test_no_common_names(folders: Folders, tmp_path: Path):
    for path in folders[0].glob("*.npz"):
        path.rename(path.with_name(f"other_{path.name}"))
    text = complaint(folders, tmp_path / "out")
    assert "drive0" in text
    assert "other_drive0" in text
    assert "same name" in text


@pytest.mark.parametrize(("side", "word"), [(0, "measured"), (1, "simulated")])
def test_ranges_in_millimetres(folders: Folders, tmp_path: Path, side: int, word: str):
    change(folders[side], range_m=1000)
    text = complaint(folders, tmp_path / "out")
    assert "millimetres" in text
    assert f"{word}/drive0.npz" in text
    assert "millimetres by 1000" in text


@pytest.mark.parametrize(("factor", "words"), [(10.0, "10 times"), (0.1, "0.1 times"), (0.3048, "0.3048 times")])
def test_measured_ranges_in_other_units(folders: Folders, tmp_path: Path, factor: float, words: str):
    change(folders[0], range_m=factor)
    text = complaint(folders, tmp_path / "out")
    assert words in text
    assert "metres on both sides" in text


@pytest.mark.parametrize("side", [0, 1])
def test_ranges_in_kilometres(folders: Folders, tmp_path: Path, side: int):
    change(folders[side], range_m=0.001)
    assert "kilometres by 1000" in complaint(folders, tmp_path / "out")


@pytest.mark.parametrize("side", [0, 1])
def test_intensities_up_to_255(folders: Folders, tmp_path: Path, side: int):
    change(folders[side], intensity=255)
    text = complaint(folders, tmp_path / "out")
    assert "must lie in 0..1" in text
    assert "divide by your sensor's scale" in text


@pytest.mark.parametrize("key", ["range_m", "intensity"])
def test_values_that_are_no_numbers(folders: Folders, tmp_path: Path, key: str):
    image, _ = read_frame(folders[0], "drive3")
    broken = np.array(getattr(image, key))
    broken[2, 5] = np.nan
    write_frame(folders[0], "drive3", image.replace(**{key: broken}))
    text = complaint(folders, tmp_path / "out")
    assert "drive3.npz" in text
    assert "finite" in text or "0..1" in text


def test_folders_with_the_same_readings(folders: Folders, tmp_path: Path):
    copy = tmp_path / "copy"
    shutil.copytree(folders[0], copy)
    assert "the same readings" in complaint((folders[0], copy), tmp_path / "out")


def test_one_folder_given_twice(folders: Folders, tmp_path: Path):
    assert "the same readings" in complaint((folders[0], folders[0]), tmp_path / "out")


@pytest.mark.parametrize("side", [0, 1])
def test_an_empty_frame(folders: Folders, tmp_path: Path, side: int):
    image, _ = read_frame(folders[side], "drive2")
    write_frame(folders[side], "drive2", image.replace(valid=np.zeros((ROWS, COLUMNS), bool)))
    text = complaint(folders, tmp_path / "out")
    assert "drive2" in text
    assert "empty" in text


def test_a_few_drives_that_are_too_narrow_for_sectors(folders: Folders, tmp_path: Path):
    for k in range(3, 8):
        (folders[0] / f"drive{k}.npz").unlink()
    text = complaint(folders, tmp_path / "out")
    assert "3 drives, of 48 columns" in text
    assert "give frames of 10 drives, or 64 columns" in text


def test_frames_of_one_drive_count_as_one_scene(folders: Folders, tmp_path: Path):
    grid, _ = read_grid(folders[0])
    for folder in folders:
        scenes = {name: {"scene": "early" if name < "drive4" else "late"} for name in frame_names(folder)}
        write_grid(folder, grid, frames=scenes)
    assert "2 drives, of 48 columns" in complaint(folders, tmp_path / "out")


@pytest.mark.parametrize("frames", [1, 8])
def test_a_single_drive_that_is_too_narrow_for_sectors(folders: Folders, tmp_path: Path, frames: int):
    for k in range(frames, 8):
        (folders[0] / f"drive{k}.npz").unlink()
    grid, _ = read_grid(folders[0])
    for folder in folders:
        write_grid(folder, grid, frames={name: {"scene": "one drive"} for name in frame_names(folder)})
    text = complaint(folders, tmp_path / "out")
    assert "48 columns" in text
    assert "give frames of 10 drives, or 192 columns" in text
