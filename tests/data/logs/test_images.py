"""Labelled range images as a log."""

import numpy as np
import pytest

from jaxsim.data import open_dataset
from jaxsim.data.cityscapes import IDS
from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.polar_frames import open_polar_frames
from tests.data.logs.made_logs import write_image


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
