"""One process a folder, whatever the command; a stranger's lock leads nowhere."""

import os
import subprocess
import sys

import pytest

from jaxsim.cli import main
from jaxsim.files import lock, unlock, working_in
from tests.full_disk import no_file_above

HOLDER = """
import sys
from jaxsim.files import lock
from jaxsim.files.whole import temporary_name
from pathlib import Path
lock(Path(sys.argv[1]), doing="writing to")
(Path(sys.argv[1]) / temporary_name("half.npz")).touch()
print("locked", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def taken(tmp_path):
    """A folder that another process has locked, and that process."""
    command = [sys.executable, "-c", HOLDER, tmp_path / "out"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"
        yield tmp_path / "out", other
        other.kill()


COMMANDS = (
    "simulate RUN --out {}",
    "export --frames 0 --out {}",
    "detect RUN --clouds CLOUDS --out {}",
    "discover RUN --out {}",
    "eval RUN --out {}",
    "eval generation --simulated A --measured B --out {}",
    "eval detection --detections A --labels B --out {}",
    "eval ablation --runs A B --out {}",
    "prepare synthetic --train 0 --out {}",
    "real2sim2real --out {}",
)


def test_every_command_that_writes_a_folder_waits_for_nobody_and_names_the_owner(taken, capsys):
    folder, other = taken
    for words in COMMANDS:
        with pytest.raises(SystemExit) as stop:
            main(words.format(folder).split())
        said = f"{stop.value.code} {capsys.readouterr().err}"
        assert f"another process (pid {other.pid} on " in said, words
        assert "give this one another --out" in said, words


def test_a_killed_owner_gives_the_folder_back_and_its_half_files_go(taken):
    folder, other = taken
    other.kill()
    other.wait()
    with working_in(folder):
        assert not list(folder.glob("*half.npz"))


def test_a_lock_that_is_a_link_is_not_followed(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / ".lock").symlink_to(victim)
    with pytest.raises(ValueError, match="is a link, which a lock never is"):
        lock(tmp_path / "run")
    assert victim.read_text() == "mine"


def test_the_owners_note_that_is_a_link_is_replaced(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / ".lock.owner").symlink_to(victim)
    lock(tmp_path / "run")
    assert str(os.getpid()) in (tmp_path / "run" / ".lock.owner").read_text()
    assert victim.read_text() == "mine"
    unlock(tmp_path / "run")


def test_within_a_process_a_folder_is_locked_once_and_stays_so(tmp_path):
    lock(tmp_path)
    with working_in(tmp_path):
        pass
    assert (tmp_path / ".lock").exists()
    unlock(tmp_path)
    assert not [*tmp_path.iterdir()]


def test_a_full_disk_leaves_no_locked_folder(tmp_path):
    with no_file_above(0), pytest.raises(OSError, match="owner"), working_in(tmp_path / "new/out"):
        pass
    assert not (tmp_path / "new").exists()


def test_a_command_that_wrote_nothing_leaves_no_folder(tmp_path):
    with pytest.raises(ValueError, match="no"), working_in(tmp_path / "a" / "b"):
        raise ValueError("no")
    assert not [*tmp_path.iterdir()]
