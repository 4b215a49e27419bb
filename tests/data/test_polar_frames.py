import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from jaxsim.data import read_lidar_top, read_pcap
from jaxsim.data.polar_frames import open_polar_frames, read_frame, read_grid, write_frame, write_grid
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


def test_incidence_and_time_mean_nothing_where_nothing_is_hit(tmp_path):
    unknown = np.full((3, 5), np.nan)
    unknown[0] = 0.1
    hit = np.zeros((3, 5))
    hit[0] = 9
    np.savez(tmp_path / "a.npz", range=hit, intensity=hit / 10, incidence=unknown, time=unknown)
    _, more = read_frame(tmp_path, "a")
    assert set(more) == {"incidence", "time"}


def test_what_may_be_said_of_a_frame_is_read(tmp_path):
    about = {"scene": "drive", "time": 1.5, "speed": 9, "heading": -0.1, "tags": ["night", "rain"]}
    right = {"azimuth": [0.1, 0.0], "elevation": [0.03, -0.1], "frames": {"a": about, "b": {}}}
    (tmp_path / "grid.json").write_text(json.dumps(right))
    assert read_grid(tmp_path)[1] == {"a": about, "b": {}}


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


def test_a_folder_is_opened_with_its_grid_and_its_frames_are_checked_against_it(tmp_path):
    write_grid(tmp_path, GRID, frames={"a": {"scene": "street"}})
    with pytest.raises(ValueError, match="no frames"):
        open_polar_frames(tmp_path)
    write_frame(tmp_path, "a", image(), semantic=np.zeros((3, 5), np.uint8))
    frames = open_polar_frames(tmp_path)
    assert frames.names == ("a",)
    assert frames.about == {"a": {"scene": "street"}}
    read, rasters = frames.read("a")
    np.testing.assert_array_equal(read.valid, image().valid)
    assert [*rasters] == ["semantic"]
    small = PolarImage(np.ones((2, 5), np.float32), np.ones((2, 5), np.float32), np.ones((2, 5), bool))
    write_frame(tmp_path, "b", small)
    with pytest.raises(ValueError, match=r"b\.npz is \(2, 5\), its grid\.json \(3, 5\)"):
        open_polar_frames(tmp_path).read("b")
