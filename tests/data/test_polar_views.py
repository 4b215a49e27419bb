"""Polar frames as training data, and labelled range images as polar frames."""

import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.data.cityscapes import IDS
from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.polar_frames import open_polar_frames, write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry import full_grid, preset, project
from jaxsim.pairs.prepared import pairs_before
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
    with pytest.raises(ValueError, match="look 81 degrees round, and views of a quarter turn"):
        open_dataset("polar", tmp_path / "window")


def write_image(path, lift_deg=0.0, label=1.0):
    """A range image of the corridor's sensor: 16 of its lines, lifted as motion compensation lifts near points."""
    azimuth = np.deg2rad(179.5 - np.arange(360))
    lift = np.random.default_rng(0).uniform(-lift_deg, lift_deg, (16, 360))
    elevation = SPEC.elevation_rad[8:24, None] + np.deg2rad(lift)
    flat = 10 * np.cos(elevation)
    cells = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), 10 * np.sin(elevation)], -1)
    scan = np.concatenate([cells, np.broadcast_to([51.0, 10.0, label], (16, 360, 3))], -1).astype(np.float32)
    scan[3, 7, 4] = 0
    path.parent.mkdir(exist_ok=True)
    np.savez(path, scan=scan)


def test_range_images_become_polar_frames_on_the_named_sensors_lines(tmp_path):
    for k in range(2):
        write_image(tmp_path / f"images/{k:02d}.npz", lift_deg=0.66)
    kind, source = source_for(tmp_path / "images")
    assert kind == "range_images"
    with pytest.raises(ValueError, match=r"--log.sensor hdl32e where the car's motion was taken out"):
        write_log(tmp_path / "images", kind, source, out=tmp_path / "no", options=LogOptions())
    options = LogOptions(sensor="hdl32e", classes="semantickitti")
    written = write_log(tmp_path / "images", kind, source, out=tmp_path / "out", options=options)
    assert (written.frames, written.rows, written.columns) == (2, 32, 360)
    assert written.sensor.beams.off_deg == pytest.approx(0.33, abs=0.02)
    frames = open_polar_frames(tmp_path / "out")
    image, more = frames.read("00")
    assert image.valid[8:24].mean() > 0.99
    assert not image.valid[11, 7]
    assert image.valid.sum() == image.valid[8:24].sum()
    np.testing.assert_allclose(image.range_m[image.valid], 10, rtol=1e-5)
    np.testing.assert_allclose(image.intensity[image.valid], 0.2, rtol=1e-5)
    assert {*np.unique(more["semantic"][image.valid])} == {IDS["car"]}
    assert {about["scene"] for about in frames.about.values()} == {"00", "01"}


@pytest.mark.parametrize(
    ("classes", "message"),
    [
        ("0:road", "has class 1, which --log.classes does not name"),
        ("0:road,1:street", r"--log.classes has '1:street'; write semantickitti, or pairs"),
        ("road", "--log.classes has 'road'"),
    ],
)
def test_classes_of_range_images_have_to_be_named(tmp_path, classes, message):
    write_image(tmp_path / "images/00.npz")
    kind, source = source_for(tmp_path / "images")
    options = LogOptions(sensor="hdl32e", classes=classes)
    with pytest.raises(ValueError, match=message):
        write_log(tmp_path / "images", kind, source, out=tmp_path / "out", options=options)


def test_real_range_images_of_nuscenes_lie_on_an_hdl_32e(samples, tmp_path):
    folder = samples / "range_images/nuscenes"
    kind, source = source_for(folder)
    written = write_log(folder, kind, source, out=tmp_path, options=LogOptions(sensor="hdl32e"), most=2)
    assert (written.rows, written.columns) == (32, 1024)
    assert written.sensor.beams.off_deg < 0.1
    assert written.filled > 0.7
    assert len(open_dataset("polar", tmp_path)) == 8
