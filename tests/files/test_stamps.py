"""What frames are read from, and whether it has changed."""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from jaxsim.config import DataConfig
from jaxsim.data import open_dataset
from jaxsim.files import files_of, read_once, stamp, stamp_of

OPENED: list[Path] | None = None


def note(event, args):
    if event == "open" and OPENED is not None and isinstance(args[0], str | os.PathLike):
        OPENED.append(Path(args[0]))


@contextmanager
def opened():
    """The files that are opened in the block."""
    global OPENED
    if note not in HOOKS:  # a hook stays for good
        sys.addaudithook(note)
        HOOKS.append(note)
    OPENED = []
    try:
        yield OPENED
    finally:
        OPENED = None


HOOKS: list = []


def test_a_stamp_changes_with_size_and_time_and_with_what_goes_or_comes(tmp_path):
    files = [tmp_path / "a.bin", tmp_path / "b.txt"]
    stamps = [stamp(files)]
    for change in (
        lambda: files[0].write_bytes(b"12"),
        lambda: files[1].write_bytes(b"12"),
        lambda: files[1].write_bytes(b"123"),
        lambda: os.utime(files[0], ns=(1, 1)),
        lambda: files[0].unlink(),
    ):
        change()
        assert stamp(files) == stamp(files)
        stamps.append(stamp(files))
    assert len({*stamps}) == len(stamps)
    assert stamp([]) == "" == stamp([], "more")


def test_a_file_is_read_once_until_another_takes_its_name(tmp_path):
    asked, path = [], tmp_path / "network.npz"
    network = read_once(lambda path, more=0: asked.append(path) or len(asked) + more)
    path.write_bytes(b"first")
    assert [network(path), network(path), network(path, 10), network(path, 10)] == [1, 1, 12, 12]
    path.write_bytes(b"other")
    os.utime(path, ns=(1, 1))
    assert network(path) == 3
    os.truncate(path, 1)
    os.utime(path, ns=(1, 1))
    assert network(path) == 4
    assert network(tmp_path / "none.npz") == 5


def test_what_is_read_of_a_folder_is_read_anew_where_one_of_its_files_changes(tmp_path):
    words = read_once(
        lambda folder: [file.read_text() for file in sorted(folder.glob("*.txt"))],
        files=lambda folder: [folder / name for name in ("a.txt", "b.txt")],
        most=1,
    )
    assert words(tmp_path) == []
    (tmp_path / "b.txt").write_text("b")
    assert words(tmp_path) == ["b"]
    assert words(tmp_path) is words(tmp_path)


def test_a_data_set_without_files_has_nothing_that_changes():
    world = open_dataset("synthetic")
    assert files_of(world, 3) == []
    assert stamp_of(world, 3, "more") == ""


ROOTS = {
    "kitti_raw": ("raw_root", 4),
    "kitti_object": ("object_root", 4),
    "kitti_step": ("step_root", 5),
    "kitti_odometry": ("odometry_root", 5),
    "vkitti2": ("virtual_root", 10),
}


@pytest.mark.parametrize("kind", [*ROOTS, "kitti"])
def test_what_opens_a_frame_is_among_its_files(kind, request):
    """Every file that is opened while the frame is read counts, and a change of any is seen."""
    fixture, at_least = ROOTS[kind if kind in ROOTS else "kitti_raw"]
    root = request.getfixturevalue(fixture)
    scenes = {"kitti_step": ("0000",), "vkitti2": ("Scene01",)}.get(kind, ())
    dataset = open_dataset(DataConfig(kind=kind, root=root, scenes=scenes))
    position = 0
    files = files_of(dataset, position)
    assert sum(file.is_file() for file in files) >= at_least
    with opened() as seen:
        dataset[position]
    read = {path for path in seen if root in path.parents}
    assert len(read) >= at_least
    assert read <= {*files}
    for file in filter(os.path.isfile, files):
        before = stamp_of(dataset, position)
        os.utime(file, ns=(1, 1))
        assert stamp_of(dataset, position) != before


def test_a_data_set_that_is_open_reads_a_changed_text_anew(virtual_root, step_root, odometry_root):
    """Workers of a cluster keep a data set open from one command to the next."""
    virtual = open_dataset(DataConfig(kind="vkitti2", root=virtual_root, scenes=("Scene01",)))
    path = virtual_root / "Scene01/clone/intrinsic.txt"
    focal = float(virtual[0].camera.camera.intrinsics[0, 0])
    header, *lines = path.read_text().splitlines()
    rows = [[*line.split()[:2], "500.5", "500.5", *line.split()[4:]] for line in lines]
    path.write_text("\n".join([header, *(" ".join(row) for row in rows)]) + "\n")
    assert (focal != 500.5, float(virtual[0].camera.camera.intrinsics[0, 0])) == (True, 500.5)

    step = open_dataset(DataConfig(kind="kitti_step", root=step_root, scenes=("0000",)))
    assert len(step[0].boxes.kind)
    (step_root / "training/label_02/0000.txt").write_text("")
    assert not len(step[0].boxes.kind)

    odometry = open_dataset(DataConfig(kind="kitti_odometry", root=odometry_root))
    assert odometry[1].time_s == pytest.approx(0.1039)
    (odometry_root / "sequences/00/times.txt").write_text("0.0\n0.25\n")
    assert odometry[1].time_s == 0.25
