import os

import numpy as np
import pytest

from jaxsim.cloud import FORMATS, save_cloud
from jaxsim.cloud.export import table_of
from jaxsim.cloud.mcap import Stamped, write_mcap
from jaxsim.frame import Cloud


def cloud():
    rng = np.random.default_rng(0)
    xyz = rng.normal(0, 10, (50, 3)).astype(np.float32)
    return Cloud(xyz, rng.random(50, dtype=np.float32), rng.random(50) < 0.8)


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


def lined():
    """A cloud with laser lines, and times of its points."""
    rng = np.random.default_rng(1)
    return cloud().replace(row=rng.integers(0, 64, 50).astype(np.int32)), rng.random(50).astype(np.float32) / 10


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


def test_an_mcap_is_read_by_the_formats_own_libraries(tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    c, time_s = lined()
    table = table_of(c, time_s)
    count = write_mcap(tmp_path / "a.mcap", [Stamped(5.25, table), Stamped(5.35, table[:7])], frame="top")
    assert count == 2
    with (tmp_path / "a.mcap").open("rb") as file:
        read = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        messages = [message for _, _, _, message in read.iter_decoded_messages(topics=["/points"])]
    first = messages[0]
    assert (first.header.frame_id, first.header.stamp.sec, first.header.stamp.nanosec) == ("top", 5, 250_000_000)
    assert [f.name for f in first.fields] == ["x", "y", "z", "intensity", "ring", "time"]
    np.testing.assert_array_equal(np.frombuffer(bytes(first.data), table.dtype), table)
    assert messages[1].width == 7
