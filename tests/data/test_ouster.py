import builtins
import shutil

import numpy as np
import pytest

from jaxsim.data import read_pcap
from jaxsim.geometry import polar_to_points

UNITS = ["OS-1-32-G_v2.1.1_1024x10", "OS-2-128-U1_v2.3.0_1024x10"]


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
    range_m = np.linalg.norm(theirs - [0, 0, sweep.grid.origin_m[0]], axis=-1)
    np.testing.assert_allclose(sweep.image.range_m[valid], range_m[valid], atol=2e-3)


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
    real = builtins.__import__

    def without_ouster(name, *args, **kwargs):
        if name.startswith("ouster"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without_ouster)
    with pytest.raises(ImportError, match=r"pip install jaxsim-lidar\[ouster\]"):
        list(read_pcap(tmp_path / "drive.pcap"))
