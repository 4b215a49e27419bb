"""Labelled range images: what is read, what is refused, and what they become as a log."""

import numpy as np
import pytest

from jaxsim.data import open_dataset
from jaxsim.data.cityscapes import IDS
from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.logs.range_images import class_names, read_range_images
from jaxsim.data.polar_frames import open_polar_frames
from tests.data.logs.made_logs import write_image


def scan(intensity=0.5, rows=4):
    cells = np.zeros((rows, 6, 6), np.float32)
    cells[..., :3] = 3, 4, 12
    cells[..., 3], cells[..., 4], cells[..., 5] = intensity, 13, 2
    cells[0, 0, 4] = 0
    return cells


def test_cells_are_read_and_those_without_a_return_are_empty(tmp_path):
    np.savez(tmp_path / "00.npz", scan=scan())
    (image,) = read_range_images(tmp_path)
    assert image.name == "00"
    assert not image.valid[0, 0]
    assert image.valid.sum() == 23
    assert image.label[0, 0] == image.intensity[0, 0] == 0
    np.testing.assert_array_equal(image.xyz_m[1, 1], (3, 4, 12))
    assert (image.range_m[1, 1], image.label[1, 1], image.intensity[1, 1]) == (13, 2, 0.5)


def test_eight_bits_in_one_file_are_eight_bits_in_all(tmp_path):
    np.savez(tmp_path / "00.npz", scan=scan(0.0))
    np.savez(tmp_path / "01.npz", scan=scan(51))
    assert [float(image.intensity[1, 1]) for image in read_range_images(tmp_path)] == pytest.approx([0, 0.2])


def changed(channel, value):
    cells = scan()
    cells[1, 1, channel] = value
    return cells


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"other": np.zeros(3)}, "no array `scan`"),
        ({"scan": np.zeros((4, 6), np.float32)}, "expected numbers of"),
        ({"scan": scan()[..., :5]}, "expected numbers of"),
        ({"scan": scan().astype(str)}, "expected numbers of"),
        ({"scan": changed(0, np.nan)}, "NaN"),
        ({"scan": changed(4, -1)}, "negative ranges"),
        ({"scan": changed(3, 300)}, "0..255"),
        ({"scan": changed(5, 1.5)}, "no classes"),
        ({"scan": changed(5, 256)}, "no classes"),
    ],
)
def test_what_cannot_be_is_told_with_its_file(tmp_path, arrays, words):
    np.savez(tmp_path / "00.npz", **arrays)
    with pytest.raises(ValueError, match=rf"^range images: .*{words}") as told:
        read_range_images(tmp_path)
    assert "00.npz" in str(told.value)


def test_an_empty_folder_and_two_sensors_in_one_are_told(tmp_path):
    with pytest.raises(ValueError, match=r"no NAME\.npz in"):
        read_range_images(tmp_path)
    np.savez(tmp_path / "00.npz", scan=scan())
    np.savez(tmp_path / "01.npz", scan=scan(rows=2))
    with pytest.raises(ValueError, match="keep each sensor in a folder"):
        read_range_images(tmp_path)


def test_classes_have_the_names_that_stand_beside_them(tmp_path):
    assert class_names(tmp_path, 3) == ("class 0", "class 1", "class 2")
    (tmp_path / "classes.json").write_text('["unlabelled", "road", "marking", "sign"]')
    assert class_names(tmp_path, 3)[1:3] == ("road", "marking")
    with pytest.raises(ValueError, match="one for each of the 5 classes"):
        class_names(tmp_path, 5)
    (tmp_path / "classes.json").write_text('{"road": 1}')
    with pytest.raises(ValueError, match="must be a list of names"):
        class_names(tmp_path, 2)


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
    assert written.layout.beams.off_deg == pytest.approx(0.33, abs=0.02)
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
    assert written.layout.beams.off_deg < 0.1
    assert written.filled > 0.7
    assert len(open_dataset("polar", tmp_path)) == 8
