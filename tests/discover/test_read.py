"""Folders from which no verdict may come; the command's own answers are in tests/cli/test_discover.py."""

import json
from pathlib import Path

import numpy as np
import pytest

from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.discover.read import read_comparison
from jaxsim.frame import PolarGrid, PolarImage

GRID = PolarGrid(
    np.linspace(1, -1, 12, dtype=np.float32), np.linspace(0, -0.3, 6, dtype=np.float32), np.zeros(6, np.float32)
)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    rng = np.random.default_rng(0)
    for side in ("simulated", "measured"):
        for k in range(3):
            image = PolarImage(
                rng.uniform(3, 60, (6, 12)).astype(np.float32),
                rng.uniform(0.1, 0.6, (6, 12)).astype(np.float32),
                np.ones((6, 12), bool),
            )
            write_frame(tmp_path / side, f"f{k}", image)
        write_grid(tmp_path / side, GRID, frames={f"f{k}": {"scene": f"s{k}", "time": 2.0 * k} for k in range(3)})
    return tmp_path / "simulated", tmp_path / "measured"


def change_grid(folder: Path, **new) -> None:
    content = json.loads((folder / "grid.json").read_text())
    (folder / "grid.json").write_text(json.dumps(content | new))


def test_pairs_come_with_their_scenes(folders):
    found = read_comparison(*folders)
    assert found.scenes == ("s0", "s1", "s2")
    assert found.measured.range_m.shape == (3, 6, 12)
    assert found.notes == ()


def test_frames_without_a_partner_are_left_out_and_told(folders):
    (folders[1] / "f2.npz").unlink()
    found = read_comparison(*folders)
    assert found.names == ("f0", "f1")
    assert "1 frames have no partner" in found.notes[0]


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(
    ("new", "message"),
    [
        ({"azimuth": np.linspace(-1, 1, 12).tolist()}, "must fall from column to column"),
        ({"azimuth": np.linspace(60, -60, 12).tolist()}, "radians, not degrees"),
        ({"azimuth": [float("nan")] * 12}, "finite angles"),
        ({"frames": ["f0"]}, "NAME"),
        ({"frames": {"f0": {"scene": "other"}}}, "must be a pair"),
    ],
)
def test_a_grid_that_cannot_be_right(folders, side, new, message):
    change_grid(folders[side], **new)
    with pytest.raises(ValueError, match=message):
        read_comparison(*folders)


def test_a_grid_that_is_no_json(folders):
    (folders[0] / "grid.json").write_text("{azimuth")
    with pytest.raises(ValueError, match="is not JSON"):
        read_comparison(*folders)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"not an archive"])
def test_a_damaged_frame_is_named(folders, content):
    (folders[1] / "f1.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"f1\.npz is no readable"):
        read_comparison(*folders)


def test_a_frame_without_returns_and_one_without_light(folders):
    shape = (6, 12)
    nothing = PolarImage(np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape, bool))
    write_frame(folders[1], "f0", nothing)
    with pytest.raises(ValueError, match="measured frame f0 is empty"):
        read_comparison(*folders)
    dark = PolarImage(np.full(shape, 9, np.float32), np.zeros(shape, np.float32), np.ones(shape, bool))
    write_frame(folders[1], "f0", dark)
    with pytest.raises(ValueError, match="intensity 0 everywhere"):
        read_comparison(*folders)
