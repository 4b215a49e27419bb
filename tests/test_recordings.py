"""Clouds as recordings: what other programs' own libraries read of them."""

import json

import numpy as np
import pytest

from jaxsim.cloud.formats import table_of
from jaxsim.data.clouds import read_cloud
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.recordings import WHOLE_FILE, Stamped, export_frames, write_mcap, write_rrd
from tests.cloud.made_clouds import lined
from tests.discover.made_gate import sides


def test_an_mcap_is_read_by_the_formats_own_libraries(tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    c, time_s = lined()
    table = table_of(c, time_s)
    write_mcap(tmp_path / "a.mcap", [Stamped(5.25, table), Stamped(5.35, table[:7])])
    with (tmp_path / "a.mcap").open("rb") as file:
        read = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        messages = [message for _, _, _, message in read.iter_decoded_messages(topics=["/points"])]
    assert len(messages) == 2
    first = messages[0]
    assert (first.header.frame_id, first.header.stamp.sec, first.header.stamp.nanosec) == ("lidar", 5, 250_000_000)
    assert [f.name for f in first.fields] == ["x", "y", "z", "intensity", "ring", "time"]
    np.testing.assert_array_equal(np.frombuffer(bytes(first.data), table.dtype), table)
    assert messages[1].width == 7


def test_a_recording_of_reruns_is_read_by_rerun(tmp_path):
    reader = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed")
    c, time_s = lined()
    table = table_of(c, time_s)
    write_rrd(tmp_path / "a.rrd", [Stamped(5.25, table), Stamped(5.35, table[:7])])
    chunks = [c for c in reader.RrdReader(str(tmp_path / "a.rrd")).store().stream() if c.entity_path == "/lidar"]
    columns = {}
    for batch in (chunk.to_record_batch() for chunk in chunks):
        columns |= {name: batch[name] for name in batch.schema.names}
    xyz_m = columns["Points3D:positions"].to_pylist()
    np.testing.assert_array_equal(xyz_m[0], np.stack([table[axis] for axis in "xyz"], axis=1))
    for name in ("intensity", "ring", "time"):
        first, second = columns[name].to_pylist()
        np.testing.assert_array_equal(first, table[name])
        assert len(second) == 7
    assert columns["scan"].cast("int64").to_pylist() == [5_250_000_000, 5_350_000_000]


def test_a_missing_rerun_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(ModuleNotFoundError, match=r"rrd: this needs rerun; pip install 'jaxsim-lidar\[rerun\]'"):
        write_rrd(tmp_path / "a.rrd", [])
    assert not (tmp_path / "a.rrd").exists()


def test_a_frame_becomes_a_file_with_a_point_a_return(tmp_path):
    folder, other = sides(tmp_path, scenes=3)
    assert export_frames(folder, tmp_path / "clouds", "npz", every=2) == 2
    frames = open_polar_frames(folder)
    files = sorted((tmp_path / "clouds").iterdir())
    assert [path.stem for path in files] == [*frames.names[::2]]
    for path in files:
        image, _ = frames.read(path.stem)
        points = read_cloud(path)
        assert len(points) == np.asarray(image.valid).sum()
        distance = np.linalg.norm(points[:, :3], axis=1)
        np.testing.assert_allclose(np.sort(distance), np.sort(image.range_m[image.valid]), rtol=1e-5)
    # What was there under its name may be of other frames.
    content = files[0].read_bytes()
    files[0].write_bytes(b"of another")
    export_frames(folder, tmp_path / "clouds", "npz", most=1)
    assert files[0].read_bytes() == content
    for polar in (folder, other):
        with pytest.raises(ValueError, match=rf"^frames: {polar} holds polar frames, .* give another --out"):
            export_frames(folder, polar, "npz")


def test_a_folder_without_frames_is_told(tmp_path):
    with pytest.raises(ValueError, match=r"no grid\.json"):
        export_frames(tmp_path, tmp_path / "out", "ply")


def test_frames_without_a_time_are_told_where_a_form_must_have_one(tmp_path, caplog):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    folder, _ = sides(tmp_path, scenes=3)
    export_frames(folder, tmp_path / "a.mcap", "mcap")
    assert "3 of 3 frames have no time in grid.json" in caplog.text


def test_where_some_frames_lack_a_time_none_has_one(tmp_path, monkeypatch, caplog):
    written = []
    keep = lambda path, clouds: written.append([stamped.time_s for stamped in clouds])  # noqa: E731
    monkeypatch.setitem(WHOLE_FILE, "mcap", keep)
    folder, _ = sides(tmp_path, scenes=3)
    grid = json.loads((folder / "grid.json").read_text())
    for k, about in enumerate(grid["frames"].values()):
        about["time"] = 1.3e9 + k
    (folder / "grid.json").write_text(json.dumps(grid))
    export_frames(folder, tmp_path / "a.mcap", "mcap")
    assert "have no time" not in caplog.text
    del about["time"]
    (folder / "grid.json").write_text(json.dumps(grid))
    export_frames(folder, tmp_path / "a.mcap", "mcap")
    assert "1 of 3 frames have no time in grid.json, so that those of 2 frames are left out" in caplog.text
    assert written == [[1.3e9, 1.3e9 + 1, 1.3e9 + 2], [0.0, 0.1, 0.2]]


@pytest.mark.parametrize(("to", "time_s"), [("mcap", -0.1), ("mcap", 2.0**31), ("osi", -1.0)])
def test_a_time_that_a_form_cannot_hold_is_told_before_anything_is_written(tmp_path, to, time_s):
    folder, _ = sides(tmp_path, scenes=3)
    grid = json.loads((folder / "grid.json").read_text())
    for k, about in enumerate(grid["frames"].values()):
        about["time"] = [0.0, time_s, 1.0][k]
    (folder / "grid.json").write_text(json.dumps(grid))
    name, out = [*grid["frames"]][1], tmp_path / f"drive_sd.{to}"
    with pytest.raises(ValueError, match=rf"^frames: the time of {name} in grid\.json is {time_s:.12g} s; --to {to} "):
        export_frames(folder, out, to)
    assert not out.exists()
