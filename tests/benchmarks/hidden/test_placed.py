"""Sensors that stand elsewhere: rays are cast from there, and nothing else of a case changes."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind.hidden.__main__ import main
from benchmarks.blind.hidden.case import key_path, make_case
from benchmarks.blind.hidden.placed import Placed

SMALL = {"effect": "none", "seed": 3, "scenes": 2, "rows": 16, "columns": 96, "nuisance": "exact"}


def ranges(folder: Path, side: str) -> np.ndarray:
    return np.stack([np.load(path)["range"] for path in sorted((folder / side).glob("*.npz"))])


@pytest.mark.parametrize("placed", [Placed(turned_deg=(0, 0, 2)), Placed(moved_m=(0.5, 0, 0)), Placed(lifted_deg=0.5)])
def test_the_measured_side_alone_is_seen_from_there(tmp_path: Path, placed: Placed):
    make_case(tmp_path / "here", **SMALL)
    make_case(tmp_path / "there", **SMALL, placed=placed)
    np.testing.assert_array_equal(ranges(tmp_path / "here", "simulated"), ranges(tmp_path / "there", "simulated"))
    moved = np.abs(ranges(tmp_path / "here", "measured") - ranges(tmp_path / "there", "measured"))
    assert np.mean(moved > 0.05) > 0.2
    assert json.loads(key_path(tmp_path / "there").read_text())["placed"]["lifted_deg"] == placed.lifted_deg
    assert json.loads(key_path(tmp_path / "here").read_text())["placed"] is None


def test_a_higher_sensor_is_farther_from_the_road_by_the_slant(tmp_path: Path):
    make_case(tmp_path / "here", **SMALL)
    make_case(tmp_path / "there", **SMALL, placed=Placed(moved_m=(0, 0, 0.2)))
    here = np.load(tmp_path / "here" / "simulated" / "0000.npz")
    road = np.isin(here["semantic"], [7]) & (here["range"] > 0)
    ratio = (ranges(tmp_path / "there", "measured")[0] / np.maximum(here["range"], 0.1))[road]
    height = np.median(ratio - 1)
    # 0.2 m on the 1.5 to 2.1 m that sensors of this world stand above the road.
    assert 0.2 / 2.2 < height < 0.2 / 1.4


def test_later_frames_are_of_the_same_drive(tmp_path: Path, capsys):
    size = ["--seed", "3", "--effect", "none", "--scenes", "2", "--rows", "16", "--columns", "96"]
    assert main(["make", str(tmp_path / "late"), *size, "--late", "0.3", "--turned", "0", "0", "0.5"]) == 0
    key = json.loads(key_path(tmp_path / "late").read_text())
    assert key["placed"] == {"turned_deg": [0, 0, 0.5], "moved_m": [0, 0, 0], "lifted_deg": 0.0, "late_s": 0.3}
