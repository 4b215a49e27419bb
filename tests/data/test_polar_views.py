"""Polar frames as training data, and labelled range images as polar frames."""

import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.data.cityscapes import IDS
from jaxsim.data.polar_frames import read_grid, write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry import full_grid, preset, project
from jaxsim.pairs.prepared import pairs_before, prepared
from jaxsim.prepare import prepare_frame

SPEC = preset("hdl32e")
QUARTER = PrepareConfig(
    inputs=("log_range", "incidence", "beam", "semantic"), depth="ip_basic", image_crop=(240, 416), columns=64,
    network_size=(32, 64),
)  # fmt: skip


def write_corridor(folder, frames=1, classes=True):
    """Level ground, and a wall 12 m to the left alone; intensity tells the quarter: ahead, left, behind, right."""
    grid = full_grid(SPEC, 720)
    azimuth, elevation = np.asarray(grid.azimuth_rad), np.asarray(grid.elevation_rad)[:, None]
    ground = 1.84 / np.tan(np.maximum(-elevation, 1e-3)) / np.cos(elevation)
    side = np.sin(azimuth)
    wall = np.where(side > 0.1, 12 / np.maximum(side, 0.1), np.inf) / np.cos(elevation)
    range_m = np.minimum(ground, wall).astype(np.float32)
    quarter = np.round(np.rad2deg(azimuth) / 90).astype(int) % 4
    image = PolarImage(range_m, np.broadcast_to((1 + quarter) / 10, range_m.shape).astype(np.float32), range_m < 80)
    semantic = np.where(ground < wall, IDS["road"], IDS["building"]).astype(np.int32)
    for k in range(frames):
        write_frame(folder, f"{k:02d}", image, **({"semantic": semantic} if classes else {}))
    write_grid(folder, grid, frames={f"{k:02d}": {"scene": f"street {k}"} for k in range(frames)})


def test_a_frame_gives_four_views_of_what_stands_on_each_side(tmp_path):
    write_corridor(tmp_path, frames=2)
    dataset = open_dataset(DataConfig(kind="polar", root=tmp_path))
    assert [dataset.name_of(i) for i in range(8)] == [f"{k:02d}-{d:03d}" for k in range(2) for d in (0, 90, 180, 270)]
    for i, frame in enumerate(dataset[k] for k in range(4, 8)):
        assert (frame.scene, frame.camera.has_image) == ("street 1", False)
        uv, depth = project(frame.camera.camera, frame.cloud.xyz_m)
        uv = np.asarray(uv)
        inside = (np.asarray(depth) > 0) & (uv[:, 0] > 0) & (uv[:, 0] < dataset.size[1] - 1)
        np.testing.assert_allclose(np.median(frame.cloud.intensity[inside]), (1 + i) / 10, rtol=1e-5)
        # All lines that a view is cut out of lie in its image.
        inside &= (uv[:, 1] > 0) & (uv[:, 1] < dataset.size[0] - 1)
        assert {*np.unique(frame.cloud.row[inside])} >= {*range(12, 32)}
    middle = dataset.size[0] // 4
    assert (dataset[5].camera.semantic[middle] == IDS["building"]).mean() > 0.9
    assert (dataset[4].camera.semantic[160] == IDS["road"]).mean() > 0.9


def test_a_view_becomes_a_pair_on_the_sensors_own_lines(tmp_path):
    write_corridor(tmp_path)
    dataset = open_dataset("polar", tmp_path)
    pair, grid = prepare_frame(dataset[1], dataset.spec, QUARTER)
    assert pair.target.shape == (32, 64)
    np.testing.assert_allclose(grid.elevation_rad, SPEC.elevation_rad, atol=1e-6)
    both = pair.measured.valid & pair.painted.valid
    assert both.mean() > 0.9
    assert np.median(np.abs(pair.measured.range_m - pair.painted.range_m)[both]) < 0.03
    assert {*np.unique(pair.painted.semantic[both])} <= {IDS["road"], IDS["building"], 0}


def test_views_of_one_moment_do_not_follow_one_another(tmp_path):
    write_corridor(tmp_path)
    data = DataConfig(kind="polar", root=tmp_path, cache=tmp_path / "cache")
    assert pairs_before(open_dataset(data), [0, 1, 2, 3], data, prepare=QUARTER) == [None] * 4


def test_a_scene_that_is_named_anew_is_its_pairs_too(tmp_path):
    """Else the same street is learned and judged."""
    write_corridor(tmp_path, frames=2)
    data = DataConfig(kind="polar", root=tmp_path, cache=tmp_path / "cache")
    grid, about = read_grid(tmp_path)
    before = prepared(open_dataset(data), [0, 4], data, prepare=QUARTER)
    write_grid(tmp_path, grid, frames=about | {"01": {"scene": "a bridge"}})
    after = prepared(open_dataset(data), [0, 4], data, prepare=QUARTER)
    assert (before.scenes, after.scenes) == (["street 0", "street 1"], ["street 0", "a bridge"])
    assert after.keys[0] == before.keys[0]


def test_what_the_frames_lack_and_where_they_come_from_is_told(tmp_path):
    write_corridor(tmp_path / "bare", classes=False)
    dataset = open_dataset("polar", tmp_path / "bare")
    with pytest.raises(ValueError, match=r"00-000: .*semantic need class labels"):
        prepare_frame(dataset[0], dataset.spec, QUARTER)
    with pytest.raises(ValueError, match=r"no grid.json in .*samples/LIDAR_TOP of a v1.0 .* jaxsim frames samples"):
        open_dataset("polar", tmp_path / "nothing")
    grid = PolarGrid(np.linspace(0.7, -0.7, 80), SPEC.elevation_rad, np.zeros(32))
    write_grid(tmp_path / "window", grid)
    image = np.full((32, 80), 5, np.float32)
    write_frame(tmp_path / "window", "00", PolarImage(image, image / 10, image > 0))
    with pytest.raises(ValueError, match="look 80 degrees round, and views of a quarter turn"):
        open_dataset("polar", tmp_path / "window")
