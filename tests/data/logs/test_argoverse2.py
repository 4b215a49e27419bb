"""A real sweep of Argoverse 2, and damaged tables."""

import numpy as np
import pytest

from tests.data.logs.made_logs import frames_of


@pytest.mark.parametrize(("rings", "top"), [("", 15.0), ("32-63", 25.0)])
def test_each_of_argoverses_two_sensors_is_told_from_its_beams(samples, tmp_path, rings, top):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    kind, frames = frames_of(samples / "argoverse2", tmp_path, rings=rings)
    assert kind == "argoverse2"
    image, _ = frames.read(frames.names[0])
    elevation = np.rad2deg(frames.grid.elevation_rad)
    # A VLP-32C's table, which nothing here was told; the lower sensor hangs upside down.
    table = np.array([15, 10.333, 7, 4.667, 3.333, 2.333, 1.667, 1.333, 1, 0.667, 0.333, 0, -0.333, -0.667, -1, -1.333])
    rest = [
        -1.667,
        -2,
        -2.333,
        -2.667,
        -3,
        -3.333,
        -3.667,
        -4,
        -4.667,
        -5.333,
        -6.148,
        -7.254,
        -8.843,
        -11.31,
        -15.639,
        -25,
    ]
    table = np.concatenate([table, rest])
    np.testing.assert_allclose(elevation, table if top == 15 else -table[::-1], atol=0.06)
    assert image.range_m.shape == (32, 1808)
    assert image.valid.mean() > 0.8  # the lower one looks up, into the sky


def test_argoverses_damaged_tables(tmp_path):
    feather = pytest.importorskip("pyarrow.feather", reason="pyarrow is not installed")
    pa = pytest.importorskip("pyarrow")
    folder = tmp_path / "log/sensors/lidar"
    folder.mkdir(parents=True)
    feather.write_feather(pa.table({"x": np.zeros(3, np.float16)}), folder / "315973157959879000.feather")
    with pytest.raises(ValueError, match="has no column y, z, intensity, laser_number, offset_ns; it has x"):
        frames_of(tmp_path / "log", tmp_path / "out")
    (folder / "315973157959879000.feather").write_bytes(b"ARROW1")
    with pytest.raises(ValueError, match=r"argoverse2: .*feather cannot be read"):
        frames_of(tmp_path / "log", tmp_path / "out")
