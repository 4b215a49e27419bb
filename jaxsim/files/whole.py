"""Files appear whole or not at all; a folder's files are listed without what is half written; names stay in it."""

from __future__ import annotations

import errno
import glob
import hashlib
import math
import os
import re
import secrets
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

SALT = f"{secrets.randbelow(10**9):09d}"
"""Of this process's temporary files: one before it may have had the same number."""
HOST = hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]
"""Of this machine's: others may share the disk."""
TEMPORARY = re.compile(r"\.jaxsim-([0-9a-f]{8})-(\d+)-(\d{9})\.(.+)", re.DOTALL)
"""Names of `replacing`'s temporary files: machine, process, its salt, and what the file will be called. No other
program's hidden files have such names."""
DAY_S = 86400.0
"""What nobody has written to for so long was left by a process that has ended, wherever it ran."""
MOST_BYTES = 4 * 2**30
"""No file that is read whole is larger."""
LONGEST_NAME = 200
"""Bytes of a file's name, its suffix left out: what any file system holds, with what `replacing` puts before it."""


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Gives a temporary path beside `path` to write to; it takes the name `path` when the block ends well.

    Errors of the system name `path`, which the user knows. Raises IsADirectoryError for a folder, and ValueError for a
    device or a pipe, whose place the file would take.
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is a device or a pipe, and a file would take its place; name a file")
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix stays last: writers such as numpy and OpenCV choose the format by it.
    temporary = path.with_name(temporary_name(path.name))
    try:
        # A link that lies there would be written through.
        temporary.unlink(missing_ok=True)
        try:
            yield temporary
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(temporary), temporary):
            error.filename = str(path)
        raise


def temporary_name(name: str) -> str:
    """What this process calls a file of this name until it is whole."""
    return f".jaxsim-{HOST}-{os.getpid()}-{SALT}.{name}"


def write_text(path: Path | str, text: str) -> Path:
    """Writes a text file in UTF-8, whole or not at all; gives its path."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def files_in(folder: Path | str, *suffixes: str) -> list[Path]:
    """The files of a folder with one of these suffixes (`.npz`), `in_order`; none where there is no such folder.

    A suffix in capitals is the same, so that what is then missed under its usual name is told, not passed over. Hidden
    files are left out: those that a killed process left half written (`replacing`), and what other programs keep of
    their own (`._000000.bin` of macOS).
    """
    paths = Path(folder).glob("*")
    found = (path for path in paths if path.suffix.lower() in suffixes and not path.name.startswith("."))
    return sorted(found, key=lambda path: in_order(path.name))


def in_order(name: str) -> list[tuple[float, str]]:
    """The key by which names are sorted: numbers in them count as numbers, so that 9 comes before 10, padded or not."""
    parts = (part for part in re.split(r"(\d+)", name) if part)
    return [(int(part), "") if part.isdecimal() else (math.inf, part) for part in parts]


def files_below(folder: Path | str, suffix: str) -> Iterator[Path]:
    """The files of a folder and of all below it whose names end so (`.pcd.bin`), by their paths, as they are found.

    Links are followed, as data sets are often folders of links; one that leads to a folder above itself ends there.
    What is hidden is left out. Raises OSError for a folder that may not be read, since its files would be missed.
    """

    def refuse(error: OSError) -> NoReturn:
        raise error

    for where, folders, names in os.walk(folder, onerror=refuse, followlinks=True):
        above = {os.path.realpath(parent) for parent in (Path(where), *Path(where).absolute().parents)}
        folders[:] = sorted(
            name
            for name in folders
            if not name.startswith(".") and os.path.realpath(os.path.join(where, name)) not in above
        )
        yield from (Path(where, name) for name in sorted(names) if name.endswith(suffix) and not name.startswith("."))


def tidy(folder: Path | str) -> int:
    """Removes what killed processes left half written in a folder and below it; how many files that were.

    What a process that still runs is writing stays, and so does every other program's hidden file. Links are passed
    over.
    """
    left = [(where, of) for where, _, names in os.walk(folder) for of in map(TEMPORARY.fullmatch, names) if of]
    return sum(_removed(Path(where, of[0]), of) for where, of in left)


def tidy_file(path: Path | str) -> None:
    """Removes what killed processes left half written of a file, which lies beside it; not what one that still runs is
    writing there."""
    path = Path(path)
    for beside in path.parent.glob(f".jaxsim-*.{glob.escape(path.name)}"):
        if (of := TEMPORARY.fullmatch(beside.name)) and of[4] == path.name:
            _removed(beside, of)


def _removed(path: Path, of: re.Match[str]) -> bool:
    """Removes a temporary file of this name if its writer has ended, by its number where it ran here; whether it
    did."""
    host, process, salt, _ = of.groups()
    try:
        ended = time.time() - path.lstat().st_mtime > DAY_S
    except FileNotFoundError:  # it was put in place, or removed by another
        return False
    if host == HOST:
        ended |= salt != SALT if int(process) == os.getpid() else _has_ended(int(process))
    if ended:
        path.unlink(missing_ok=True)
    return ended


def _has_ended(process: int) -> bool:
    """Whether there is no process of this number; of systems that cannot tell, no."""
    if os.name != "posix":
        return False
    try:
        os.kill(process, 0)  # signal 0 is sent to nobody
    except (ProcessLookupError, OverflowError):
        return True
    except OSError:
        return False
    return False


def check_apart(out: Path | str, *read: Path | str | None, by: str) -> None:
    """Raises ValueError where what is to be written is one of the files or folders that are read, by whatever link: it
    would be lost."""
    out = Path(out)
    for path in read:
        if path is not None and out.exists() and Path(path).exists() and out.samefile(path):
            how = "written into" if out.is_dir() else "written over"
            raise ValueError(f"{by}: {path} is read, and would be {how}; give another --out")


def check_name(name: str, *, by: str) -> str:
    """The same name back, where a file can bear it and stays in its folder.

    Raises ValueError for a path, for names that are hidden, empty or too long, and for control characters.
    """
    if (
        not name
        or name.startswith(".")
        or len(name.encode(errors="surrogatepass")) > LONGEST_NAME
        or re.search(r"[/\\:\x00-\x1f\x7f]", name)
    ):
        shown = repr(name if len(name) <= 60 else f"{name[:57]}...")
        raise ValueError(
            f"{by}: {shown} came as a frame's name and would become a file's; it must be 1 to {LONGEST_NAME} "
            "bytes without / \\ : and control characters, and must not begin with a dot"
        )
    return name


def file_of(folder: Path | str, name: str, suffix: str, *, by: str) -> Path:
    """The path of a file of a folder whose name comes out of data. Raises ValueError as `check_name`."""
    return Path(folder) / f"{check_name(name, by=by)}{suffix}"


def check_size(path: Path | str, *, by: str, most: int = MOST_BYTES) -> int:
    """Bytes of a file. Raises ValueError where it is none (a folder, a pipe), or larger than `most`; and OSError."""
    about = Path(path).stat()
    if not stat.S_ISREG(about.st_mode):
        raise ValueError(f"{by}: {path} is no regular file")
    if about.st_size > most:
        raise ValueError(f"{by}: {path} has {about.st_size} bytes, and files of its kind at most {most}")
    return about.st_size
