import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from jaxsim.data import read_lidar_top, read_pcap
from jaxsim.data.polar_frames import read_frame, read_grid, write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage

GRID = PolarGrid(
    np.linspace(0.6, -0.6, 5, dtype=np.float32),
    np.array([0.03, -0.1, -0.3], np.float32),
    np.zeros(3, np.float32),
)


def image():
    rng = np.random.default_rng(0)
    return PolarImage(
        rng.uniform(2, 80, (3, 5)).astype(np.float32),
        rng.random((3, 5), dtype=np.float32),
        rng.random((3, 5)) < 0.7,
    )


def test_what_is_written_is_read_and_no_return_becomes_the_mask(tmp_path):
    write_grid(tmp_path, GRID, frames={"a": {"scene": "drive 1", "time": 0.1}})
    write_frame(tmp_path, "a", image(), semantic=np.full((3, 5), 7, np.int32))
    grid, frames = read_grid(tmp_path)
    got, more = read_frame(tmp_path, "a")
    np.testing.assert_allclose(grid.azimuth_rad, GRID.azimuth_rad, atol=1e-7)
    assert frames == {"a": {"scene": "drive 1", "time": 0.1}}
    np.testing.assert_array_equal(got.valid, image().valid)
    np.testing.assert_array_equal(got.range_m[got.valid], image().range_m[got.valid])
    assert (more["semantic"] == 7).all()


def test_missing_grid_says_what_a_folder_of_polar_frames_has(tmp_path):
    with pytest.raises(ValueError, match=r"no grid\.json"):
        read_grid(tmp_path)


def test_grid_without_elevation_is_named(tmp_path):
    (tmp_path / "grid.json").write_text(json.dumps({"azimuth": [0.0]}))
    with pytest.raises(ValueError, match="lacks elevation"):
        read_grid(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"intensity": None}, "lacks intensity"),
        ({"intensity": np.full((3, 5), 128.0)}, "must lie in 0..1"),
        ({"intensity": np.zeros((2, 5))}, "both must be"),
        ({"range": np.full((3, 5), np.nan)}, "finite metres"),
    ],
)
def test_frames_of_wrong_content_are_refused(tmp_path, change, message):
    arrays = {"range": np.ones((3, 5)), "intensity": np.zeros((3, 5)), **change}
    np.savez(tmp_path / "a.npz", **{key: value for key, value in arrays.items() if value is not None})
    with pytest.raises(ValueError, match=message):
        read_frame(tmp_path, "a")


def test_the_pages_example_turns_a_recording_into_polar_frames(samples, tmp_path, monkeypatch):
    pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    for suffix in ("pcap", "json"):
        shutil.copy(samples / f"ouster/OS-1-32-G_v2.1.1_1024x10.{suffix}", tmp_path / f"recording.{suffix}")
    page = (Path(__file__).parents[2] / "docs" / "polar-frames.md").read_text()
    (example,) = (b for b in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "read_pcap" in b)
    monkeypatch.chdir(tmp_path)
    exec(example, {})
    grid, frames = read_grid(tmp_path / "measured")
    assert len(grid.elevation_rad) == 32
    (name,) = frames
    (sweep,) = read_pcap(tmp_path / "recording.pcap")
    got, _ = read_frame(tmp_path / "measured", name)
    np.testing.assert_array_equal(got.valid, sweep.image.valid)
    np.testing.assert_allclose(got.intensity[got.valid], sweep.image.intensity[got.valid])


def test_a_nuscenes_sweep_is_kept_as_a_polar_frame(samples, tmp_path):
    sweep = read_lidar_top(next((samples / "nuscenes").rglob("*.pcd.bin")))
    write_grid(tmp_path, sweep.grid, frames={sweep.name: {"scene": sweep.scene, "time": sweep.time_s}})
    write_frame(tmp_path, sweep.name, sweep.image)
    grid, frames = read_grid(tmp_path)
    got, _ = read_frame(tmp_path, sweep.name)
    assert list(frames) == [sweep.name]
    assert got.range_m.shape == (32, len(grid.azimuth_rad))
    np.testing.assert_array_equal(got.range_m[got.valid], sweep.image.range_m[sweep.image.valid])
