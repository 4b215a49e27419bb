import json
import shutil
import sys

import numpy as np
import pytest

from jaxsim.data import read_lidar_top, read_pcap, sweeps
from jaxsim.geometry import polar_to_points, preset

NAME = "n015-2018-07-24-11-22-45+0800__LIDAR_TOP__1532402927647951.pcd.bin"
UNITS = ["OS-1-32-G_v2.1.1_1024x10", "OS-2-128-U1_v2.3.0_1024x10"]


@pytest.fixture
def sweep_file(tmp_path):
    """Six firings every 2 degrees, clockwise from the rear; ring k (0 lowest) sees a wall at 10 m + k / 10."""
    elevation = preset("hdl32e").elevation_rad[::-1]
    azimuth = np.deg2rad(np.repeat(179 - 2.0 * np.arange(180), 6))[:, None]
    r = 10 + np.arange(32) / 10
    forward, left, up = (
        r * np.cos(elevation) * np.cos(azimuth),
        r * np.cos(elevation) * np.sin(azimuth),
        r * np.sin(elevation) + 0 * azimuth,
    )
    ring = np.arange(32) + 0 * azimuth
    points = np.stack([-left, forward, up, 5 * ring, ring], axis=-1).astype("<f4")
    path = tmp_path / NAME
    points.tofile(path)
    return path


def test_rings_become_rows_top_first_and_forward_is_in_the_middle(sweep_file):
    sweep = read_lidar_top(sweep_file, columns=180)
    assert sweep.image.valid.all()
    np.testing.assert_allclose(sweep.image.range_m[:, 90], 10 + np.arange(31, -1, -1) / 10, rtol=1e-5)
    np.testing.assert_allclose(sweep.image.intensity[:, 0], 5 * np.arange(31, -1, -1) / 255, rtol=1e-6)
    points = polar_to_points(sweep.image, sweep.grid).xyz_m.reshape(32, 180, 3)
    assert points[0, 90, 0] > 10
    assert points[0, 45, 1] > 10  # left of forward stands left of the middle


def test_name_drive_and_time_come_from_the_file_name(sweep_file):
    sweep = read_lidar_top(sweep_file)
    assert sweep.scene == "n015-2018-07-24-11-22-45+0800"
    assert sweep.time_s == pytest.approx(1532402927.647951, abs=1e-5)


def test_a_beam_that_did_not_come_back_is_no_point_at_the_sensor(sweep_file):
    points = np.fromfile(sweep_file, "<f4").reshape(180, 6, 32, 5)
    points[40:50, :, 3, :3] = (0.0, -0.45, -0.01)
    points.tofile(sweep_file)
    valid = read_lidar_top(sweep_file, columns=180).image.valid
    assert not valid[28, 40:50].any()
    assert valid.sum() == valid.size - 10


def test_a_turn_cut_between_two_points_or_firings_is_refused(sweep_file):
    whole = sweep_file.read_bytes()
    for points in (34560 - 1, 34560 - 32 * 11, 17280, 32):
        sweep_file.write_bytes(whole[: 20 * points])
        with pytest.raises(ValueError, match=rf"holds {points} points; a whole turn is 1070 firings or more"):
            read_lidar_top(sweep_file)


def _scaled(points):
    points[:, 3] /= 255


def _nan(points):
    points[5, 0] = np.nan


def _ring(points):
    points[:, 4] += 1


def _millimetres(points):
    points[:, :3] *= 1000


def _sorted_by_ring(points):
    points[:] = points[np.argsort(points[:, 4], kind="stable")]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_scaled, r"intensity spans 0\.\.0\.6\d*; nuScenes stores 0\.\.255"),
        (_nan, "1 of 34560 points are NaN"),
        (_ring, r"fifth value spans 1\.\.32; it must be the ring"),
        (_millimetres, "must be in metres"),
        (_sorted_by_ring, "in order: the file is cut off, or was sorted"),
    ],
)
def test_a_spoilt_file_says_what_is_wrong(sweep_file, change, message):
    points = np.fromfile(sweep_file, "<f4").reshape(-1, 5)
    change(points)
    points.tofile(sweep_file)
    with pytest.raises(ValueError, match=message):
        read_lidar_top(sweep_file)


def test_a_truncated_or_missing_file(sweep_file, tmp_path):
    sweep_file.write_bytes(sweep_file.read_bytes()[:-8])
    with pytest.raises(ValueError, match="no whole number of points"):
        read_lidar_top(sweep_file)
    with pytest.raises(ValueError, match="there is no"):
        read_lidar_top(tmp_path / "none.pcd.bin")


def test_the_real_sweep_has_no_gaps_from_sampling(samples):
    path = next((samples / "nuscenes/samples/LIDAR_TOP").glob("*.bin"))
    sweep = read_lidar_top(path)
    valid = sweep.image.valid
    assert valid.shape == (32, 900)
    assert 0.7 < valid.mean() < 0.85
    lonely = ~valid[:, 1:-1] & valid[:, :-2] & valid[:, 2:]
    assert lonely.mean() < 0.025
    assert sweep.image.intensity.max() <= 1


@pytest.fixture(params=UNITS)
def recording(samples, request):
    pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    return samples / "ouster" / f"{request.param}.pcap"


def test_points_lie_where_the_makers_software_puts_them(recording):
    from ouster.sdk import core
    from ouster.sdk.open_source import open_source

    (sweep,) = read_pcap(recording)
    frame = next(f for frames in open_source(str(recording)) for f in frames)
    info = frame.sensor_info
    theirs = core.destagger(info, core.XYZLut(info)(frame))
    returned = core.destagger(info, frame.field("RANGE")) > 0
    ours = np.asarray(polar_to_points(sweep.image, sweep.grid).xyz_m).reshape(theirs.shape)
    # The first column of the grid is the one whose azimuth is +pi, which is not the file's first.
    shift = next(k for k in range(64) if (np.roll(returned, -k, axis=1) == sweep.image.valid).all())
    theirs, valid = np.roll(theirs, -shift, axis=1), sweep.image.valid
    off = np.linalg.norm(ours - theirs, axis=-1)[valid] / np.maximum(sweep.image.range_m[valid], 1)
    assert np.rad2deg(off).max() < 0.36 / 2
    # A column's azimuth is within half a column of its beams'; distance from the axis and height are exact.
    np.testing.assert_allclose(np.hypot(*ours[valid].T[:2]), np.hypot(*theirs[valid].T[:2]), atol=5e-4)
    np.testing.assert_allclose(ours[valid][:, 2], theirs[valid][:, 2], atol=5e-4)


def described(recording, **changes):
    """The description of a recording with other entries."""
    return json.loads(recording.with_suffix(".json").read_text()) | changes


def test_beams_of_an_os_0_start_beside_the_axis(samples, tmp_path):
    """28 mm beside it, and up to 45 degrees up and down: no recording of one is at hand, so one is described."""
    pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    from ouster.sdk import core
    from ouster.sdk.open_source import open_source

    recording = samples / "ouster/OS-1-32-G_v2.1.1_1024x10.pcap"
    meta = tmp_path / "os0.json"
    wide = np.linspace(45, -45, 32).round(2).tolist()
    meta.write_text(json.dumps(described(recording, lidar_origin_to_beam_origin_mm=27.67, beam_altitude_angles=wide)))
    (sweep,) = read_pcap(recording, meta=meta)
    frame = next(f for frames in open_source(str(recording), meta=[str(meta)]) for f in frames)
    theirs = core.destagger(frame.sensor_info, core.XYZLut(frame.sensor_info)(frame))
    ours = np.asarray(polar_to_points(sweep.image, sweep.grid).xyz_m).reshape(theirs.shape)
    returned = core.destagger(frame.sensor_info, frame.field("RANGE")) > 0
    shift = next(k for k in range(64) if (np.roll(returned, -k, axis=1) == sweep.image.valid).all())
    theirs, valid = np.roll(theirs, -shift, axis=1), sweep.image.valid
    assert np.abs(np.hypot(*ours[valid].T[:2]) - np.hypot(*theirs[valid].T[:2])).max() < 1e-3
    assert np.abs(ours[valid][:, 2] - theirs[valid][:, 2]).max() < 1e-3


def test_a_description_of_another_sensor_is_told(samples):
    pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    one, other = (samples / f"ouster/{name}" for name in UNITS[:2])
    with pytest.raises(
        ValueError, match=r"not one packet of .* is of the sensor that .*describes \(OS-\d.*1024 columns"
    ):
        list(read_pcap(one.parent / f"{one.name}.pcap", meta=other.parent / f"{other.name}.json"))


def test_a_profile_without_what_is_asked_for_names_what_it_has(recording, monkeypatch):
    real = sweeps._open_pcap

    def without_signal(path, meta):
        source, core = real(path, meta)

        def frames():
            for group in source:
                for frame in group:
                    frame.del_field("SIGNAL")
                yield group

        return frames(), core

    monkeypatch.setattr(sweeps, "_open_pcap", without_signal)
    with pytest.raises(ValueError, match=r"holds no signal: its profile, .* take intensity='reflectivity'"):
        list(read_pcap(recording, intensity="signal"))


def test_columns_fall_from_the_rear_over_the_left(recording):
    (sweep,) = read_pcap(recording)
    azimuth = sweep.grid.azimuth_rad.astype(float)
    step = 2 * np.pi / len(azimuth)
    assert np.pi - step < azimuth[0] <= np.pi
    np.testing.assert_allclose(np.diff(azimuth), -step, atol=1e-6)
    assert (np.diff(sweep.grid.elevation_rad) < 0).all()
    assert sweep.scene == recording.stem


def test_intensity_is_reflectivity_or_photons_on_a_named_scale(recording):
    (reflectivity,) = read_pcap(recording)
    (signal,) = read_pcap(recording, intensity="signal", full_scale=8000.0)
    assert reflectivity.image.intensity.max() == 1
    steps = reflectivity.image.intensity * 255
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)
    assert 0.1 < signal.image.intensity.max() < 1
    with pytest.raises(ValueError, match=r"signal reaches \d+, above full_scale=100"):
        list(read_pcap(recording, intensity="signal", full_scale=100.0))
    with pytest.raises(ValueError, match="known: reflectivity, signal"):
        list(read_pcap(recording, intensity="ambient"))


def test_a_recording_needs_its_description(recording, tmp_path):
    copy = shutil.copy(recording, tmp_path / "drive.pcap")
    with pytest.raises(ValueError, match=r"there is no .*drive\.json; a \.pcap is read with"):
        list(read_pcap(copy))
    assert len(list(read_pcap(copy, meta=recording.with_suffix(".json")))) == 1


def test_files_that_are_no_recording_and_recordings_cut_short(recording, tmp_path):
    meta = recording.with_suffix(".json")
    with pytest.raises(ValueError, match=r"there is no .*none\.pcap"):
        list(read_pcap(tmp_path / "none.pcap", meta=meta))
    (tmp_path / "text.pcap").write_bytes(b"no packets")
    with pytest.raises(ValueError, match=r"text\.pcap .* cannot be read"):
        list(read_pcap(tmp_path / "text.pcap", meta=meta))
    half = recording.read_bytes()[: recording.stat().st_size // 2]
    (tmp_path / "half.pcap").write_bytes(half)
    with pytest.raises(ValueError, match="no whole turn, 1 broken"):
        list(read_pcap(tmp_path / "half.pcap", meta=meta))


def test_without_the_sdk_the_error_names_the_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "ouster.sdk.core", None)
    with pytest.raises(ImportError, match=r"pip install 'jaxsim-lidar\[ouster\]'"):
        list(read_pcap(tmp_path / "drive.pcap"))
