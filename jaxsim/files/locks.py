"""A folder is one process's at a time."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from jaxsim.files.texts import read_text
from jaxsim.files.whole import tidy, write_text

NAME, OWNER = ".lock", ".lock.owner"
"""The locked file, and who holds it: in a file of its own, since what is locked cannot be read on every system."""

_held: dict[Path, FileLock] = {}
"""Locks of this process, by their files."""


def lock(folder: Path, *, doing: str = "training in", instead: str = "another --run.name") -> None:
    """Keeps a folder (made if need be) for this process until it ends, by a lock on `folder/.lock`.

    The system itself releases the lock however the process ends, so a killed run resumes at once; what that one left
    half written is removed. Locking a folder again in the same process is fine. Raises ValueError where another process
    has locked it, worded with what is `doing` there and what to give `instead`, and where the lock is a link.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder.resolve() / NAME
    if path in _held:
        if path.exists():
            return
        _held.pop(path).release(force=True)  # of a folder that was deleted
    file = FileLock(path, thread_local=False)
    try:
        file.acquire(blocking=False)
    except Timeout:
        named = folder / OWNER
        owner = read_text(named, by="run", most=1000).strip() if named.is_file() else "it left no number"
        raise ValueError(
            f"run: another process ({owner}) is {doing} {folder}, and two would spoil each other's files; "
            f"wait until it ends, stop it, or give this one {instead}"
        ) from None
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise ValueError(
            f"run: {path} is a link, which a lock never is: whoever made it wants another file overwritten; look at "
            "where the folder comes from, and remove the link"
        ) from None
    _held[path] = file
    write_text(folder / OWNER, f"pid {os.getpid()} on {socket.gethostname()}\n")
    tidy(folder)


def unlock(folder: Path) -> None:
    """Gives a folder back before this process ends; one that this process has not locked is left alone."""
    path = folder.resolve() / NAME
    file = _held.pop(path, None)
    if file is not None:
        (folder / OWNER).unlink(missing_ok=True)
        with suppress(PermissionError):  # of Windows, where a locked file stays
            path.unlink(missing_ok=True)
        file.release()


@contextmanager
def working_in(folder: Path | str, *, doing: str = "writing to") -> Iterator[None]:
    """Keeps a folder for this process while the block runs. A folder that it has locked before stays locked after.

    Where the block wrote nothing, no folder is left that was not there. Raises ValueError as `lock`.
    """
    folder = Path(folder)
    before = folder.resolve() / NAME in _held
    new = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        lock(folder, doing=doing, instead="another --out")
        yield
    finally:
        if not before:
            unlock(folder)
            with suppress(OSError):  # one that holds something ends this
                for parent in new:
                    parent.rmdir()
