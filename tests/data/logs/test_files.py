"""Clouds in files of general formats, written here by other libraries or byte by byte."""

import json

import numpy as np
import pytest

from tests.data.logs.conftest import ELEVATION, FIRINGS, RINGS, expected
from tests.data.logs.made_logs import ATTRIBUTES, carla_buffer, check, frames_of, las, pcd


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd_of_every_encoding(tmp_path, fields, encoding):
    kind, frames = frames_of(pcd(tmp_path / "scan.pcd", fields, encoding), tmp_path / "out")
    assert kind == "pcd"
    check(frames, fields)


def test_pandasets_scan_keeps_its_rows_and_nearly_all_its_points(samples, tmp_path):
    pytest.importorskip("pypcd4", reason="pypcd4 is not installed")
    _, frames = frames_of(samples / "pandaset", tmp_path)
    image, _ = frames.read(frames.names[0])
    assert image.range_m.shape[0] == 64
    assert (np.diff(frames.grid.elevation_rad) < 0).all()
    # 77 295 points; two that were put into neighbouring cells of 0.194 degrees may share one of 0.2.
    assert image.valid.sum() > 0.97 * 77295
    # Neighbouring columns see neighbouring places: no seams.
    both = image.valid[:, 1:] & image.valid[:, :-1]
    assert np.median(np.abs(np.diff(image.range_m, axis=1))[both]) < 0.1


def test_a_suffix_in_capitals_is_no_other(tmp_path, fields):
    kind, frames = frames_of(pcd(tmp_path / "SCAN.PCD", fields, "binary"), tmp_path / "out")
    assert kind == "pcd"
    check(frames, fields)


@pytest.mark.parametrize("order", ["<", ">", "ascii"])
def test_ply_of_every_byte_order(tmp_path, fields, order):
    plyfile = pytest.importorskip("plyfile", reason="plyfile is not installed")
    vertices = np.empty(len(fields["x"]), [(name, value.dtype) for name, value in fields.items()])
    for name, value in fields.items():
        vertices[name] = value
    ascii_text = order == "ascii"
    data = plyfile.PlyData(
        [plyfile.PlyElement.describe(vertices, "vertex")], text=ascii_text, byte_order="=" if ascii_text else order
    )
    data.write(str(tmp_path / "scan.ply"))
    kind, frames = frames_of(tmp_path / "scan.ply", tmp_path / "out")
    assert kind == "ply"
    check(frames, fields)


@pytest.mark.parametrize(("ring", "suffix"), [(True, ".las"), (False, ".las"), (True, ".laz")])
def test_las_with_and_without_rings(tmp_path, fields, ring, suffix):
    if suffix == ".laz":
        pytest.importorskip("lazrs", reason="lazrs is not installed")
    kind, frames = frames_of(las(tmp_path / f"scan{suffix}", fields, ring=ring), tmp_path / "out", lines=RINGS)
    assert kind == "las"
    check(frames, fields, rtol=2e-5)
    _, more = frames.read("scan")
    assert more["time"].max() == pytest.approx((FIRINGS - 1) * 5e-4 + (RINGS - 1) * 1e-6, abs=1e-6)


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".las"])
@pytest.mark.parametrize("damage", ["cut", "empty", "other"])
def test_damaged_files_are_named(tmp_path, fields, suffix, damage):
    path = tmp_path / f"scan{suffix}"
    if suffix == ".ply":
        path.write_bytes(
            b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n" + bytes(36)
        )
    else:
        (pcd(path, fields, "binary") if suffix == ".pcd" else las(path, fields))
    whole = path.read_bytes()
    path.write_bytes({"cut": whole[: len(whole) * 3 // 4], "empty": b"", "other": b"\x00" * 4096}[damage])
    module = {".pcd": "pypcd4", ".ply": "plyfile", ".las": "laspy"}[suffix]
    pytest.importorskip(module, reason=f"{module} is not installed")
    with pytest.raises(ValueError, match=rf"{suffix[1:]}: .*scan\{suffix}"):
        frames_of(path, tmp_path / "out")


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".las"])
def test_a_file_whose_end_was_never_written_is_named(tmp_path, fields, suffix):
    path = tmp_path / f"scan{suffix}"
    if suffix == ".ply":
        plyfile = pytest.importorskip("plyfile", reason="plyfile is not installed")
        vertices = np.empty(len(fields["x"]), [(name, value.dtype) for name, value in fields.items()])
        for name, value in fields.items():
            vertices[name] = value
        plyfile.PlyData([plyfile.PlyElement.describe(vertices, "vertex")]).write(str(path))
    else:
        (pcd(path, fields, "binary") if suffix == ".pcd" else las(path, fields))
    whole = path.read_bytes()
    path.write_bytes(whole[:-20000] + bytes(20000))
    with pytest.raises(ValueError, match=rf"{suffix[1:]}: .*scan\{suffix} cannot be read .*on are zeros alone"):
        frames_of(path, tmp_path / "out")


@pytest.mark.parametrize(
    ("suffix", "at", "told"), [(".las", 247, "promises .* points"), (".laz", None, "chunks of 2880")]
)
def test_room_is_made_for_no_more_points_than_a_scan_has(tmp_path, fields, suffix, at, told):
    laspy = pytest.importorskip("laspy", reason="laspy is not installed")
    pytest.importorskip("lazrs", reason="lazrs is not installed")
    path = las(tmp_path / f"scan{suffix}", fields)
    content = bytearray(path.read_bytes())
    if at is None:  # the number of chunks, in the table whose place stands before the points
        with laspy.open(path) as opened:
            first = opened.header.offset_to_point_data
        at = int.from_bytes(content[first : first + 8], "little") + 4
    content[at : at + 4] = b"\xff" * 4
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"las: .*scan\{suffix} cannot be read .*{told}"):
        frames_of(path, tmp_path / "out")


@pytest.mark.parametrize("records", [2**27, 2**32 - 1])
def test_no_more_records_are_looked_for_than_lie_before_the_points(tmp_path, fields, records):
    path = las(tmp_path / "scan.las", fields)
    content = bytearray(path.read_bytes())
    content[100:104] = records.to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"las: .*scan\.las cannot be read .*promises {records} records"):
        frames_of(path, tmp_path / "out")
    path.write_bytes(content[:99])
    with pytest.raises(ValueError, match=r"scan\.las cannot be read"):
        frames_of(path, tmp_path / "out")


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    (tmp_path / "scan.ply").write_bytes(b"ply\n")
    monkeypatch.setitem(__import__("sys").modules, "plyfile", None)
    with pytest.raises(ModuleNotFoundError, match=r"ply: this needs plyfile; pip install 'jaxsim-lidar\[ply\]'"):
        frames_of(tmp_path / "scan.ply", tmp_path / "out")


"""As `dict(lidar.attributes)` has them: all are texts."""


def test_carlas_ray_cast(tmp_path, fields):
    kind, frames = frames_of(carla_buffer(tmp_path, fields, semantic=False), tmp_path / "out")
    assert kind == "carla"
    np.testing.assert_allclose(frames.grid.elevation_rad, ELEVATION, atol=1e-6)
    check(frames, fields)


def test_carlas_semantic_lidar_is_range_incidence_class_and_object(tmp_path, fields):
    _, frames = frames_of(carla_buffer(tmp_path, fields, semantic=True), tmp_path / "out")
    image, more = frames.read("000010")
    range_m, _ = expected(fields)
    np.testing.assert_allclose(image.range_m, range_m, rtol=1e-5)
    np.testing.assert_allclose(image.intensity, np.exp(-0.004 * range_m), rtol=1e-4)
    np.testing.assert_allclose(more["incidence"], np.pi / 3, rtol=1e-5)
    assert (more["semantic"] == 26).all()  # tag 14 of 0.9.15 is a car
    assert (more["instance"] == 77).all()


def test_of_a_folder_of_carlas_recordings_all_are_read_whatever_describes_the_sensor(tmp_path, fields):
    for name in ("a", "b"):
        (tmp_path / "log" / name).mkdir(parents=True)
        carla_buffer(tmp_path / "log" / name, fields, semantic=False)
    _, frames = frames_of(tmp_path / "log", tmp_path / "out")
    meta = (tmp_path / "log/a/attributes.json").rename(tmp_path / "sensor.json")
    (tmp_path / "log/a/attributes.json").write_text('{"type": "sensor.lidar.ray_cast"}')
    _, described = frames_of(tmp_path / "log", tmp_path / "described", meta=meta)
    assert described.names == frames.names == ("a_000010", "b_000010")


def test_carlas_buffers_are_checked(tmp_path, fields):
    folder = carla_buffer(tmp_path, fields, semantic=False)
    raw = (folder / "000010.raw").read_bytes()
    (folder / "000010.raw").write_bytes(raw[:-4])
    with pytest.raises(ValueError, match=r"no whole number of points of sensor.lidar.ray_cast"):
        frames_of(folder, tmp_path / "out")
    (folder / "000010.raw").write_bytes(raw)
    (folder / "attributes.json").write_text(
        json.dumps(ATTRIBUTES | {"type": "sensor.lidar.ray_cast", "upper_fov": "2"})
    )
    with pytest.raises(ValueError, match=r"degrees off the beams of attributes.json"):
        frames_of(folder, tmp_path / "out")
    (folder / "attributes.json").write_text('{"type": "sensor.lidar.ray_cast"}')
    with pytest.raises(ValueError, match="lacks channels, upper_fov"):
        frames_of(folder, tmp_path / "out")
    for key, value, told in (
        ("channels", "many", r"attributes.json: channels: 'many' is no number"),
        ("range", "1e30", r"attributes.json: range is 1e\+30; it must lie in 0.1..1000"),
        ("lower_fov", "40", r"are no sensor's"),
    ):
        about = ATTRIBUTES | {"type": "sensor.lidar.ray_cast", key: value}
        (folder / "attributes.json").write_text(json.dumps(about))
        with pytest.raises(ValueError, match=told):
            frames_of(folder, tmp_path / "out")
    points = bytearray((carla_buffer(tmp_path, fields, semantic=True) / "000010.raw").read_bytes())
    points[20:24] = (25).to_bytes(4, "little")
    (folder / "000010.raw").write_bytes(points)
    with pytest.raises(ValueError, match=r"CARLA 0.9.10 has 23"):
        frames_of(folder, tmp_path / "out", version="0.9.10")
