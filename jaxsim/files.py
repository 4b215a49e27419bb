"""Files appear whole or not at all, so that a killed program leaves nothing half written."""

from __future__ import annotations

import os
import socket
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Gives a temporary path beside `path` to write to; it takes the name `path` when the block ends well."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix stays last: writers such as numpy and OpenCV choose the format by it.
    temporary = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


_held: dict[tuple[int, int], int] = {}
"""Open lock files of this process, by device and inode: the lock lasts as long as its file is open."""


def hold(folder: Path, *, doing: str = "training in", instead: str = "another --run.name") -> None:
    """Keeps a folder (made if need be) for this process until it ends, by a lock on `folder/.lock`.

    The system itself lets go of the lock however the process ends, so a killed run resumes at once. Holding a
    folder again in the same process is fine. Raises ValueError where another process holds it, worded with what is
    `doing` there and what to give `instead`. Where there are no such locks (Windows, some network drives) nothing is
    locked, and a warning says so.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ModuleNotFoundError:
        _warn(folder, doing, "this platform has no fcntl")
        return
    file = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
    status = os.fstat(file)
    key = (status.st_dev, status.st_ino)
    if key in _held:
        os.close(file)
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        owner = os.read(file, 200).decode(errors="replace").strip()
        os.close(file)
        raise ValueError(
            f"run: another process ({owner or 'it left no number'}) is {doing} {folder}, and two would spoil "
            f"each other's files; wait until it ends, stop it, or give this one {instead}"
        ) from None
    except OSError as error:
        os.close(file)
        _warn(folder, doing, str(error))
        return
    os.ftruncate(file, 0)
    os.write(file, f"pid {os.getpid()} on {socket.gethostname()}\n".encode())
    _held[key] = file


def let_go(folder: Path) -> None:
    """Gives a folder back before this process ends; one that it does not hold is left alone."""
    status = (folder / ".lock").stat() if (folder / ".lock").exists() else None
    file = _held.pop((status.st_dev, status.st_ino), None) if status else None
    if file is not None:
        os.close(file)


def _warn(folder: Path, doing: str, why: str) -> None:
    warnings.warn(
        f"run: {folder} cannot be locked ({why}); see to it yourself that no other process is {doing} it", stacklevel=4
    )
