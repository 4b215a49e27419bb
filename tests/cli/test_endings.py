"""How commands end: one line and the right exit code for all that is to be expected."""

import errno
import signal
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import pytest

from jaxsim.cli import main
from jaxsim.cli.endings import stop_on_error, words_of
from tests.programs import PATIENCE_S, environment, running

EXPECTED = {
    "the disk is full; make room": OSError(errno.ENOSPC, "No space left on device", "out/a.npz"),
    "you may not; mend its permissions": PermissionError(errno.EACCES, "Permission denied", "out"),
    "the disk is read-only": OSError(errno.EROFS, "Read-only file system", "out"),
    "a part of the path is a file": NotADirectoryError(errno.ENOTDIR, "Not a directory", "file/out"),
    "it is there already, and is no folder": FileExistsError(errno.EEXIST, "File exists", "out"),
    "it is a folder": IsADirectoryError(errno.EISDIR, "Is a directory", "a.json"),
    "no such file": FileNotFoundError(errno.ENOENT, "No such file or directory", "a.npz"),
    "not enough memory": MemoryError("Unable to allocate 4.00 TiB"),
    "a file is damaged .error: incorrect header": zlib.error("incorrect header"),
    "a file is damaged .BadZipFile": zipfile.BadZipFile("not a zip"),
    "a file is damaged .EOFError: no message": EOFError(),
    "a file is damaged .RecursionError": RecursionError("maximum recursion depth exceeded"),
    "a text is no utf-8": UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"),
    r"letters that are no utf-8: '/data/lat\\udcfc'; name it otherwise": UnicodeEncodeError(
        "utf-8", "/data/lat\udcfc/a", 9, 10, "surrogates not allowed"
    ),
    "use it so": ValueError("kitti: use it so"),
    "is not installed": ModuleNotFoundError("PyTorch is not installed"),
}


@pytest.mark.parametrize("words", EXPECTED)
def test_an_expected_failure_is_one_line_and_status_1(words):
    with pytest.raises(SystemExit, match=f"^error: .*{words}") as stop, stop_on_error():
        raise EXPECTED[words]
    assert "\n" not in str(stop.value)
    assert isinstance(stop.value.code, str)  # which Python prints, and ends with 1


def test_a_link_to_itself_is_told_by_its_name(tmp_path):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    with pytest.raises(SystemExit, match=rf"^error: {loop}: it is a link that leads to itself$"), stop_on_error():
        loop.resolve(strict=True)
    with pytest.raises(SystemExit, match=r"loop.*: it is a link that leads to itself$"):
        main(["eval", "generation", "--simulated", "a", "--measured", "b", "--out", str(loop)])


def test_the_systems_errors_name_the_file():
    assert words_of(EXPECTED["the disk is full; make room"]) == (
        "out/a.npz: the disk is full; make room, and the same command goes on"
    )


def test_running_out_of_a_devices_memory_is_told_as_such():
    assert "not enough memory (RESOURCE_EXHAUSTED" in str(words_of(RuntimeError("RESOURCE_EXHAUSTED: Out of memory")))


def test_a_platform_that_is_not_there_is_told_as_such(monkeypatch):
    monkeypatch.setenv("JAX_PLATFORMS", "cuda")
    for error in (RuntimeError("Unable to initialize backend 'cuda': no plugin\nmore"), AssertionError()):
        assert str(words_of(error)).startswith("JAX starts no device (")
    # Without a platform that was asked for, an assertion is a fault; and so is one that says something.
    assert words_of(AssertionError("x")) is None
    monkeypatch.delenv("JAX_PLATFORMS")
    assert words_of(AssertionError()) is None


@pytest.mark.parametrize("error", [TypeError("x"), AttributeError("x"), RuntimeError("x"), KeyError("x")])
def test_a_fault_of_our_own_keeps_its_traceback(error):
    with pytest.raises(type(error)), stop_on_error():
        raise error


def test_the_traceback_of_an_expected_failure_can_be_asked_for(monkeypatch):
    monkeypatch.setenv("JAXSIM_TRACEBACK", "1")
    with pytest.raises(ValueError, match="use it so"), stop_on_error():
        raise EXPECTED["use it so"]


WAITS = """
import sys, time
from jaxsim.cli import stop_on_error
with stop_on_error():
    print("ready", flush=True)
    time.sleep(600)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_is_one_line_and_its_status(tmp_path, number, status):
    with running(tmp_path, "-c", WAITS) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        said = process.communicate(timeout=PATIENCE_S)[0]
    assert process.returncode == status
    assert said.strip() == "stopped; files that were finished stay, and the same command goes on with what is missing"


def jaxsim(*words: str | Path, work: Path, **more) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "jaxsim", *map(str, words)]
    return subprocess.run(command, cwd=work, capture_output=True, text=True, **more)


@pytest.mark.long
def test_a_place_that_cannot_be_written_to_is_told_before_any_work(tmp_path):
    (tmp_path / "file").write_text("")
    folders = ["--measured", tmp_path / "no", "--simulated", tmp_path / "no"]
    for out in ("file", "file/below"):
        ended = jaxsim("discover", *folders, "--out", tmp_path / out, work=tmp_path, env=environment())
        assert ended.returncode == 1
        assert ended.stderr.startswith(f"error: {tmp_path / 'file'}")
        assert ended.stderr.count("\n") == 1


NAMELESS = """
import os, pwd, sys

# Where it is installed flax asks it about colours, and it asks for a home.
sys.modules["IPython"] = None

def unknown(uid):
    raise KeyError(f"getpwuid(): uid not found: {uid}")

pwd.getpwuid = unknown
from jaxsim.cli import main
main(["simulate", "embedded", "--data.kind", "synthetic", "--frames", "0", "--out", "out", "--formats", "bin"])
"""


@pytest.mark.slow
def test_a_user_without_a_name_or_a_home_can_work(tmp_path):
    """As containers have them: `docker run --user 12345`."""
    unset = ("HOME", "XDG_CACHE_HOME", "JAX_COMPILATION_CACHE_DIR", "USER", "LOGNAME", "LNAME", "USERNAME")
    variables = {name: value for name, value in environment().items() if name not in unset}
    ended = subprocess.run(
        [sys.executable, "-c", NAMELESS], cwd=tmp_path, capture_output=True, text=True, env=variables
    )
    assert ended.returncode == 0, ended.stderr
    assert len(list((tmp_path / "out" / "polar").glob("*.npz"))) == 1
