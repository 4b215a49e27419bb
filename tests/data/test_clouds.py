import numpy as np
import pytest

from jaxsim.data.clouds import cloud_files, compensated_spec, read_cloud
from jaxsim.frame import Cloud
from jaxsim.geometry import preset

XYZ = np.float32([[1, 2, 3], [4, 5, 6]])


def test_both_formats_hold_the_same_points(tmp_path):
    intensity = np.float32([0.25, 0.5])
    np.column_stack([XYZ, intensity]).astype("<f4").tofile(tmp_path / "a.bin")
    np.savez(tmp_path / "a.npz", xyz=XYZ, intensity=intensity)
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.bin"), read_cloud(tmp_path / "a.npz"))


def test_a_cloud_without_intensity_has_three_columns(tmp_path):
    np.savez(tmp_path / "a.npz", xyz=XYZ)
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.npz"), XYZ)


@pytest.mark.parametrize(("name", "message"), [("none", "holds no array xyz"), ("broken", "is no readable")])
def test_what_is_no_cloud_says_so(tmp_path, name, message):
    np.savez(tmp_path / "none.npz", intensity=XYZ[:, 0])
    (tmp_path / "broken.npz").write_text("no archive")
    with pytest.raises(ValueError, match=message):
        read_cloud(tmp_path / f"{name}.npz")


def test_a_polar_frame_is_told_how_it_becomes_a_cloud(tmp_path):
    np.savez(tmp_path / "a.npz", range=XYZ, intensity=XYZ)
    with pytest.raises(ValueError, match=r"its folder lacks grid\.json"):
        read_cloud(tmp_path / "a.npz")
    (tmp_path / "grid.json").write_text("{}")
    with pytest.raises(ValueError, match=r"is a polar frame: `jaxsim frames .* --to npz --out CLOUDS` writes clouds"):
        read_cloud(tmp_path / "a.npz")


def test_a_name_that_comes_twice_is_told_though_another_lies_between(tmp_path):
    for name in ("a.bin", "a.c.bin", "a.npz"):
        (tmp_path / name).touch()
    with pytest.raises(ValueError, match=r"holds a twice, as \.bin and \.npz; leave one"):
        cloud_files(tmp_path)


def test_suffixes_in_capitals_are_read_as_they_are_listed(tmp_path):
    np.column_stack([XYZ, np.zeros(2)]).astype("<f4").tofile(tmp_path / "a.BIN")
    (file,) = cloud_files(tmp_path)
    np.testing.assert_array_equal(read_cloud(file)[:, :3], XYZ)


def test_a_scan_whose_motion_was_taken_out_is_read_once_for_its_beams(tmp_path, monkeypatch):
    read = []

    def read_scan(path, rows):
        read.append(path.stem)
        return Cloud(XYZ, np.zeros(2), np.ones(2, bool), np.zeros(2, int))  # no cone fits two points

    monkeypatch.setattr("jaxsim.data.clouds.read_scan", read_scan)
    (tmp_path / "a.bin").touch()
    assert compensated_spec(tmp_path / "a.bin", "file_order") == preset("hdl64e")
    assert read == ["a"]
