"""Labelled range images: what is read, and what is refused."""

import numpy as np
import pytest

from jaxsim.data.range_images import class_names, read_range_images


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
