"""What is half written is never taken for a file, and no name leaves its folder."""

import errno
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxsim.data.polar_frames import frame_names, write_frame
from jaxsim.evaluate.cloud_folder import clouds_in
from jaxsim.evaluate.generation import open_folder
from jaxsim.files import (
    check_apart,
    check_size,
    file_of,
    files_below,
    files_in,
    replacing,
    tidy,
    tidy_file,
    write_image,
    write_text,
)
from jaxsim.files.whole import HOST, SALT, temporary_name
from jaxsim.frame import PolarImage
from jaxsim.metrics.detection.files import frames_with_results
from tests.full_disk import no_file_above


def test_leftovers_of_a_kill_and_files_of_other_programs_are_no_frames(tmp_path):
    np.savez(tmp_path / "a.npz", xyz=np.ones((1, 3)), intensity=np.ones(1))
    (tmp_path / "a.txt").write_text("")
    for name in (".4711.b.npz", ".4711.b.bin", ".4711.b.txt", "._a.npz", "._a.txt"):
        (tmp_path / name).write_bytes(b"half")
    assert [path.name for path in files_in(tmp_path, ".npz", ".bin")] == ["a.npz"]
    assert frame_names(tmp_path) == [path.stem for path in clouds_in(tmp_path)] == ["a"]
    assert open_folder(tmp_path).names == ("a",)
    assert frames_with_results(tmp_path) == ["a"]


def test_files_below_follows_links_but_no_circle_and_tells_of_a_folder_it_may_not_read(tmp_path, monkeypatch):
    (tmp_path / "elsewhere/data").mkdir(parents=True)
    (tmp_path / "root/.trash").mkdir(parents=True)
    for place in ("elsewhere/data/b.bin", "root/a.bin", "root/a.txt", "root/.trash/c.bin", "root/._a.bin"):
        (tmp_path / place).touch()
    (tmp_path / "root/drive").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere/back").symlink_to(tmp_path / "root")
    (tmp_path / "elsewhere/again").symlink_to(tmp_path / "elsewhere")
    root = tmp_path / "root"
    assert list(files_below(root, ".bin")) == [root / "a.bin", root / "drive/data/b.bin"]
    scandir = os.scandir

    def forbidden(place):
        if os.fspath(place).endswith("data"):
            raise PermissionError(errno.EACCES, "Permission denied", os.fspath(place))
        return scandir(place)

    monkeypatch.setattr(os, "scandir", forbidden)
    with pytest.raises(PermissionError, match="drive/data"):
        list(files_below(root, ".bin"))


def test_the_next_run_tidies_what_is_its_own_alone(tmp_path):
    elsewhere = "0" * 8
    polar = tmp_path / "run" / "polar"
    polar.mkdir(parents=True)
    left = [
        f".jaxsim-{HOST}-{_ended()}-{SALT}.b.npz",
        f".jaxsim-{HOST}-{os.getpid()}-{'0' * 9}.b.npz",  # of a process before this one that had its number
        f".jaxsim-{elsewhere}-1-{SALT}.old.npz",
    ]
    # Of an editor, of rsync, of a user, of this process and of one on another machine that shares the disk.
    others = [".000000.txt.swp", ".000000.bin.Ab12Cd", ".2024.notes.md", "b.npz"]
    stay = [*others, temporary_name("b.npz"), f".jaxsim-{elsewhere}-1-{SALT}.b.npz"]
    for name in (*left, *stay):
        (polar / name).touch()
    two_days_ago = time.time() - 2 * 86400
    os.utime(polar / left[-1], (two_days_ago, two_days_ago))
    assert tidy(tmp_path) == 3
    assert {path.name for path in polar.iterdir()} == {*stay}


def _ended():
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_what_a_killed_process_left_of_a_file_goes_and_what_one_that_runs_writes_stays(tmp_path):
    left = f".jaxsim-{HOST}-{_ended()}-{SALT}"
    half = [f"{left}.a[1].mcap", temporary_name("a[1].mcap"), f"{left}.b.mcap", f"{left}.b.a[1].mcap", "a[1].mcap"]
    for name in half:
        (tmp_path / name).touch()
    tidy_file(tmp_path / "a[1].mcap")
    assert {path.name for path in tmp_path.iterdir()} == {*half[1:]}


def test_no_device_pipe_or_folder_is_replaced_by_a_file(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(ValueError, match="is a device or a pipe, and a file would take its place; name a file"):
        write_text(pipe, "a")
    assert pipe.is_fifo()
    for folder in (tmp_path, "."):
        with pytest.raises(IsADirectoryError):
            write_text(folder, "a")
    assert [*tmp_path.iterdir()] == [pipe]


def test_an_error_of_the_system_names_the_file_that_was_asked_for(tmp_path):
    with no_file_above(1000), pytest.raises(OSError) as stop:  # noqa: PT011, the number is asked for below
        write_text(tmp_path / "a.txt", "a" * 5000)
    assert (stop.value.errno, stop.value.filename) == (errno.EFBIG, str(tmp_path / "a.txt"))
    with no_file_above(1000), pytest.raises(OSError) as stop:  # noqa: PT011
        write_image(tmp_path / "a.png", np.random.default_rng(0).integers(0, 255, (99, 99, 3), np.uint8), by="test")
    assert (stop.value.errno, stop.value.filename) == (errno.EFBIG, str(tmp_path / "a.png"))
    with pytest.raises(FileNotFoundError) as stop, replacing(tmp_path / "a.txt"):
        (tmp_path / "another").read_text()
    assert stop.value.filename == str(tmp_path / "another")
    assert not list(tmp_path.iterdir())


def test_what_is_read_is_not_written_over_by_whatever_link(tmp_path):
    (tmp_path / "a.json").write_text("")
    (tmp_path / "b.json").symlink_to("a.json")
    (tmp_path / "c.json").hardlink_to(tmp_path / "a.json")
    for name in ("a.json", "b.json", "c.json"):
        with pytest.raises(
            ValueError, match=r"^bake: .*a\.json is read, and would be written over; give another --out"
        ):
            check_apart(tmp_path / name, None, tmp_path / "a.json", by="bake")
    with pytest.raises(ValueError, match="is read, and would be written into"):
        check_apart(tmp_path / ".", tmp_path, by="bake")
    check_apart(tmp_path / "new.json", tmp_path / "new.json", tmp_path / "a.json", by="bake")


def test_a_suffix_in_capitals_is_no_other(tmp_path):
    for name in ("a.bin", "b.BIN", "c.txt"):
        (tmp_path / name).touch()
    assert [path.name for path in files_in(tmp_path, ".bin")] == ["a.bin", "b.BIN"]


def test_a_link_where_the_temporary_goes_is_not_written_through(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / temporary_name("a.txt")).symlink_to(victim)
    with replacing(tmp_path / "a.txt") as path:
        path.write_text("new")
    assert victim.read_text() == "mine"
    assert (tmp_path / "a.txt").read_text() == "new"


def test_text_is_utf_8_and_takes_the_place_of_what_was_there(tmp_path):
    path = write_text(tmp_path / "new" / "a.txt", "old")
    assert write_text(path, "Δ ln I").read_bytes() == "Δ ln I".encode()
    assert [*path.parent.iterdir()] == [path]


@pytest.mark.parametrize(
    "name", ["/x/y", "../../y", "..", ".", "", ".hidden", "a/b", "a\\b", "C:a", "a\0b", "a\n", "a" * 300]
)
def test_a_name_that_would_leave_the_folder_is_refused(tmp_path, name):
    with pytest.raises(ValueError, match="came as a frame's name and would become a file's"):
        file_of(tmp_path, name, ".png", by="eval")
    ones = np.ones((2, 2), np.float32)
    with pytest.raises(ValueError, match="would become a file's"):
        write_frame(tmp_path / "polar", name, PolarImage(ones, ones, ones > 0))
    assert not [*tmp_path.iterdir()]


def test_a_drives_name_stays_as_it_is(tmp_path):
    name = "2011_09_26_drive_0001_sync-0000000005"
    assert file_of(tmp_path, name, ".png", by="eval") == tmp_path / f"{name}.png"


def test_a_pipe_is_no_file_and_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ValueError, match="no regular file"):
        check_size(tmp_path / "pipe", by="test")


def test_numbers_in_names_count_as_numbers(tmp_path):
    names = ["9.bin", "10.bin", "0011.bin", "a.bin", "b2.bin", "b10.bin"]
    for name in names:
        (tmp_path / name).touch()
    assert [path.name for path in files_in(tmp_path, ".bin")] == names
