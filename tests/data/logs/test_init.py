"""What a log is told from."""

from pathlib import Path

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, known_sources, source_for, source_table
from jaxsim.data.logs.makers import kitti_files
from tests.data.logs.conftest import RINGS, room
from tests.data.logs.made_logs import frames_of


def test_what_is_no_log_is_told_with_all_that_are(tmp_path):
    with pytest.raises(ValueError, match="looks like no log that is known; name its kind: --kind carla or pcd or"):
        source_for(tmp_path)
    with pytest.raises(ValueError, match=r"no source 'sick'\. Known: carla, pcd"):
        source_for(tmp_path, "sick")
    with pytest.raises(ValueError, match="there is no"):
        source_for(tmp_path / "nothing")
    with pytest.raises(ValueError, match=r"no source 'velodine'; did you mean velodyne\? Known: carla, pcd"):
        source_for(tmp_path, "velodine")
    (tmp_path / "grid.json").write_text("{}")
    with pytest.raises(ValueError, match="holds polar frames already; --to mcap"):
        source_for(tmp_path)


def test_a_folder_of_several_kinds_tells_which_is_read(tmp_path, caplog):
    (tmp_path / "a.pcd").touch()
    assert source_for(tmp_path)[0] == "pcd"
    assert not caplog.messages
    (tmp_path / "b.ply").touch()
    (tmp_path / "broken.npz").touch()
    assert source_for(tmp_path)[0] == "pcd"
    assert caplog.messages == [
        f"frames: {tmp_path} holds logs of several kinds, and pcd is read; for the other give --kind ply, and an --out "
        "of its own"
    ]


def test_a_folder_of_recordings_asks_for_one(tmp_path):
    for name in ("a.pcap", "b.pcap"):
        (tmp_path / name).touch()
    with pytest.raises(
        ValueError, match=r"holds 2 recordings, each of which is a log of its own; give one, as .*a\.pcap"
    ):
        source_for(tmp_path)


@pytest.mark.parametrize("place", ["drive/velodyne_points/data", "training/velodyne"])
def test_the_folder_of_kittis_scans_is_a_log_as_those_above_it_are(tmp_path, place):
    (tmp_path / place).mkdir(parents=True)
    (tmp_path / place / "000000.bin").touch()
    for folder in (tmp_path / place, *(tmp_path / place).parents[: place.count("/") + 1]):
        assert source_for(folder)[0] == "kitti"


def test_linked_drives_are_read_as_those_that_lie_there(tmp_path):
    for drive in ("root/0001_sync", "elsewhere/0002_sync"):
        (tmp_path / drive / "velodyne_points/data").mkdir(parents=True)
        (tmp_path / drive / "velodyne_points/data/0000000000.bin").touch()
    (tmp_path / "root/0002_sync").symlink_to(tmp_path / "elsewhere/0002_sync")
    assert source_for(tmp_path / "root")[0] == "kitti"
    assert [drive for _, drive, _ in kitti_files(tmp_path / "root")] == ["0001_sync", "0002_sync"]
    (tmp_path / "samples").mkdir()
    (tmp_path / "samples/x.pcd.bin").touch()
    (tmp_path / "links").mkdir()
    (tmp_path / "links/samples").symlink_to(tmp_path / "samples")
    kind, source = source_for(tmp_path / "links")
    assert (kind, [item.name for item in source.items(tmp_path / "links", LogOptions())]) == ("nuscenes", ["x"])


def scan_at(root, *places):
    for place in places:
        (root / place).parent.mkdir(parents=True, exist_ok=True)
        (root / place).touch()


def test_scans_of_tracking_are_known_by_their_sequence(tmp_path):
    scan_at(tmp_path, *(f"{part}/velodyne/000{k}/000000.bin" for part in ("testing", "training") for k in (0, 1)))
    assert [found[:2] for found in kitti_files(tmp_path)] == [
        (f"{sequence}-000000", sequence) for sequence in ("testing_0000", "testing_0001", "0000", "0001")
    ]


def test_a_scans_drive_is_the_folder_that_holds_it_wherever_the_command_is_given(tmp_path, monkeypatch):
    scan_at(tmp_path, "my_sync/object/training/velodyne/000000.bin", "0001_sync/velodyne_points/data/0000000000.bin")
    assert kitti_files(tmp_path / "my_sync")[0][:2] == ("000000", "000000")
    monkeypatch.chdir(tmp_path / "0001_sync")
    assert kitti_files(Path("."))[0][:2] == ("0001_sync-0000000000", "0001_sync")


def test_a_package_adds_a_source(tmp_path, monkeypatch):
    from jaxsim.data.logs import Item, LogScan, Source

    def items(path, options):
        for k in range(2):
            fields = room(seed=k)
            scan = LogScan(
                name=f"{k:03d}",
                scene="acme",
                xyz_m=np.stack([fields[a] for a in "xyz"], axis=1),
                intensity=fields["intensity"].astype("f4"),
                ring=fields["ring"].astype(int),
                full_scale=255.0,
            )
            yield Item(scan.name, lambda scan=scan: scan)

    class Point:
        name, value = "acme", "acme_lidar.log:SOURCE"

        def load(self):
            return Source("ACME", lambda path: path.suffix == ".acme", items)

    monkeypatch.setattr("jaxsim.data.logs.entry_points", lambda group: [Point()] if group == "jaxsim.sources" else [])
    assert next(iter(known_sources())) == "acme"
    (tmp_path / "x.acme").write_bytes(b"")
    kind, frames = frames_of(tmp_path / "x.acme", tmp_path / "out")
    assert (kind, frames.names, len(frames.grid.elevation_rad)) == ("acme", ("000", "001"), RINGS)
    Point.load = lambda self: 5
    with pytest.raises(ValueError, match="must be a Source"):
        known_sources()


def test_the_table_has_a_line_a_family_and_what_to_install():
    lines = source_table().splitlines()
    assert [line.split()[0] for line in lines] == [*known_sources()]
    assert any(line.endswith("pip install 'jaxsim-lidar[ros]'") for line in lines)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("A.LAS", "las"), ("A.PLY", "ply"), ("A.PCAP", "velodyne"), ("A.OSF", "ouster"), ("A.FEATHER", "argoverse2")),
        *(("A.BIN", "kitti"), ("A.OSI", "osi"), ("A.MCAP", "ros"), ("A.BAG", "ros")),
    ],
)
def test_a_suffix_in_capitals_tells_the_kind(tmp_path, name, kind):
    (tmp_path / name).touch()
    assert source_for(tmp_path / name)[0] == kind
