import os
from dataclasses import replace
from inspect import unwrap

import numpy as np
import pytest

from jaxsim.cloud import FORMATS, points_of, save_cloud
from jaxsim.cloud.formats import table_of
from jaxsim.data.clouds import read_cloud
from jaxsim.frame import Cloud
from tests.cloud.made_clouds import cloud, lined


def want(c):
    return np.column_stack([c.xyz_m, c.intensity])[c.valid]


def test_bin_is_kittis_four_floats_a_point(tmp_path):
    path = save_cloud(tmp_path / "a.bin", cloud())
    np.testing.assert_array_equal(np.fromfile(path, "<f4").reshape(-1, 4), want(cloud()))


@pytest.mark.parametrize("suffix", [".pcd", ".ply"])
def test_headers_say_what_the_bytes_hold(tmp_path, suffix):
    path = save_cloud(tmp_path / f"a{suffix}", cloud())
    raw = path.read_bytes()
    end = b"DATA binary\n" if suffix == ".pcd" else b"end_header\n"
    header, body = raw.split(end, 1)
    points = len(want(cloud()))
    assert (f"POINTS {points}" if suffix == ".pcd" else f"element vertex {points}").encode() in header
    np.testing.assert_array_equal(np.frombuffer(body, "<f4").reshape(-1, 4), want(cloud()))


def test_npz_holds_named_arrays(tmp_path):
    with np.load(save_cloud(tmp_path / "a.npz", cloud())) as archive:
        np.testing.assert_array_equal(archive["xyz"], want(cloud())[:, :3])


def test_unknown_suffix_names_the_known_ones(tmp_path):
    with pytest.raises(ValueError, match=r"\.bin, \.pcd, \.ply, \.npz, \.las"):
        save_cloud(tmp_path / "a.xyz", cloud())


def test_a_batch_is_refused(tmp_path):
    one = cloud()
    batch = Cloud(one.xyz_m[None], one.intensity[None], one.valid[None])
    with pytest.raises(ValueError, match="one cloud"):
        save_cloud(tmp_path / "a.bin", batch)


def test_a_failed_write_leaves_the_old_file_and_no_rest(tmp_path, monkeypatch):
    path = save_cloud(tmp_path / "a.ply", cloud())
    before = path.read_bytes()

    def fails(points, file):
        file.write(b"half")
        raise OSError("disk full")

    monkeypatch.setitem(FORMATS, ".ply", fails)
    with pytest.raises(OSError, match="disk full"):
        save_cloud(path, cloud())
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["a.ply"]


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".npz", ".las"])
def test_ring_and_time_come_back_by_other_programs(tmp_path, suffix):
    module = {".pcd": "pypcd4", ".ply": "plyfile", ".npz": "numpy", ".las": "laspy"}[suffix]
    library = pytest.importorskip(module, reason=f"{module} is not installed")
    c, time_s = lined()
    path = save_cloud(tmp_path / f"a{suffix}", c, time_s=time_s)
    read = {
        ".pcd": lambda: library.PointCloud.from_path(path).pc_data,
        ".ply": lambda: library.PlyData.read(str(path))["vertex"].data,
        ".npz": lambda: dict(np.load(path)),
        ".las": lambda: library.read(str(path)),
    }[suffix]()
    np.testing.assert_array_equal(read["ring"], c.row[c.valid])
    np.testing.assert_allclose(read["gps_time" if suffix == ".las" else "time"], time_s[c.valid], rtol=1e-6)
    scale = 65535 if suffix == ".las" else 1
    np.testing.assert_allclose(np.asarray(read["intensity"]) / scale, c.intensity[c.valid], atol=1e-5)
    x = read["xyz"][:, 0] if suffix == ".npz" else read["x"]
    np.testing.assert_allclose(np.asarray(x), c.xyz_m[c.valid, 0], atol=6e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"xyz_m": lambda a: a * np.nan}, "are NaN or infinite"),
        ({"xyz_m": lambda a: a * 1e6}, "coordinates must be in metres"),
        ({"intensity": lambda a: a * 300 + 2}, r"intensity spans .* it must lie in 0\.\.1"),
        ({"intensity": lambda a: np.full(a.shape, 200, np.uint8)}, r"divide 0\.\.255 by 255"),
        ({"intensity": lambda a: a[:-1]}, r"intensity is .* points; give a number a point"),
        ({"xyz_m": lambda a: np.concatenate([a, a[:, :1]], 1)}, r"one cloud of shape \(n, 3\), got \(\d+, 4\)"),
        ({"valid": lambda a: a.astype(np.uint8)}, r"valid is .* of uint8 .* give true or false a point"),
    ],
)
def test_what_readers_refuse_is_not_written(tmp_path, change, message):
    wrong = replace(cloud(), **{name: made(getattr(cloud(), name)) for name, made in change.items()})
    for suffix in (".bin", ".ply"):
        with pytest.raises(ValueError, match=f"cloud: .*{message}"):
            save_cloud(tmp_path / f"a{suffix}", wrong)
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize(
    ("row", "time_s", "message"),
    [
        (lambda n: np.arange(n) + 0.5, None, "row is .* of float64 for .* points; give a whole number a point"),
        (lambda n: np.arange(n - 1), None, "row is .* give a whole number a point"),
        (None, lambda n: np.zeros(n - 1), "time_s is .* give seconds a point"),
        (None, lambda n: np.zeros((n, 1)), "time_s is .* give seconds a point"),
        (None, lambda n: np.full(n, np.nan), "time_s is NaN or infinite in .* give seconds, or leave it out"),
    ],
)
def test_rows_and_times_are_one_a_point(row, time_s, message):
    count = len(cloud().valid)
    wrong = replace(cloud(), row=row and row(count))
    with pytest.raises(ValueError, match=f"cloud: {message}"):
        unwrap(table_of)(wrong, time_s and time_s(count))


def test_an_array_is_answered_with_the_cloud_that_it_would_be():
    with pytest.raises(ValueError, match=r"cloud: ndarray came; give a Cloud \(jaxsim\.frame\)"):
        unwrap(points_of)(want(cloud()))


def test_a_suffix_may_be_in_capitals(tmp_path):
    small, large = save_cloud(tmp_path / "a.pcd", cloud()), save_cloud(tmp_path / "A.PCD", cloud())
    assert large.read_bytes() == small.read_bytes()


def test_a_cloud_without_points_is_written_with_a_warning(tmp_path):
    nothing = replace(cloud(), valid=np.zeros(cloud().valid.shape, bool))
    with pytest.warns(UserWarning, match=r"a\.npz holds no points: no reader here takes it"):
        path = save_cloud(tmp_path / "a.npz", nothing)
    with pytest.raises(ValueError, match="holds no points"):
        read_cloud(path)


def test_points_that_are_not_valid_may_be_anything(tmp_path):
    one = cloud()
    xyz = np.where(one.valid[:, None], one.xyz_m, np.nan)
    path = save_cloud(tmp_path / "a.npz", replace(one, xyz_m=xyz))
    np.testing.assert_array_equal(read_cloud(path), want(one))


def test_a_row_that_is_none_is_no_ring(tmp_path):
    wrong = replace(cloud(), row=np.full(cloud().valid.shape, -1, np.int32))
    with pytest.raises(ValueError, match=r"rows span -1\.\.-1; a file's ring is 0 to 65535"):
        save_cloud(tmp_path / "a.ply", wrong)
