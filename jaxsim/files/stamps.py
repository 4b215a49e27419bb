"""What frames are read from, and whether that has changed since: told by files' sizes and times; none is read for it.

A data set of files says which they are by `files_of(i)`; others, such as the embedded world, have none, and nothing of
theirs can change. What a frame has from a file of the whole set, which changes as frames are added, `told_of(i)` says
as a text.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

from jaxsim.files.whole import file_of

_Of = ParamSpec("_Of")
_Read = TypeVar("_Read")

_log = logging.getLogger(__name__)

CHANGED = "what it was made of has changed since"
"""Why a frame is made anew whose files have another stamp than it was made with."""


def files_of(dataset: Any, position: int) -> list[Path]:
    """The files that a frame is read from, those too that it may do without and lacks; none where the data set has no
    files."""
    of_frame = getattr(dataset, "files_of", None)
    return [] if of_frame is None else list(of_frame(position))


def stamp(files: Iterable[Path], more: str = "") -> str:
    """Sixteen hexadecimal digits that change where a file's size or time of modification does, where one goes or comes,
    and with the text `more`; empty where there are no files."""
    lines = []
    for file in files:
        try:
            about = file.stat()
        except (FileNotFoundError, NotADirectoryError):
            lines.append(f"{file.name} is not there")
        else:
            lines.append(f"{file.name} {about.st_size} {about.st_mtime_ns}")
    return hashlib.sha256("\n".join([*lines, more]).encode()).hexdigest()[:16] if lines else ""


def sha256_of(path: Path) -> str:
    """SHA-256 of what a file holds, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_once(
    read: Callable[Concatenate[Path, _Of], _Read],
    *,
    files: Callable[[Path], Iterable[Path]] = lambda path: [path],
    most: int | None = None,
) -> Callable[Concatenate[Path, _Of], _Read]:
    """`read` of a path, which is asked again only where the path's `files` have changed: one of the same name may hold
    another thing, and a data set may outlive a change, on a worker of a cluster. The last `most` are kept (None: all),
    in each process."""
    kept = lru_cache(maxsize=most)(lambda _, path, *of, **named: read(path, *of, **named))

    @wraps(read)
    def reading(path: Path, *of: _Of.args, **named: _Of.kwargs) -> _Read:
        return kept(stamp(files(path)), path, *of, **named)

    return reading


def stamp_of(dataset: Any, position: int, more: str = "") -> str:
    """The stamp of a frame's files, and of what else is told of it: what was made of the frame is as good as new while
    it stays the same."""
    told_of = getattr(dataset, "told_of", None)
    return stamp(files_of(dataset, position), more if told_of is None else f"{told_of(position)} {more}")


def kept_files(folder: Path, dataset: Any, positions: Sequence[int], *, stamps: Sequence[str], by: str) -> list[Path]:
    """Where what is made of frames is kept, an .npz each. By their names: a drive that is added to a data set moves the
    positions of all that come after it. By the stamps of what it is made of, too: of files that have changed since it
    is no longer theirs."""
    suffixes = [f".{stamp}.npz" if stamp else ".npz" for stamp in stamps]
    names = map(dataset.name_of, positions)
    return [file_of(folder, name, suffix, by=by) for name, suffix in zip(names, suffixes, strict=True)]


def why_anew(was: str, now: str) -> str:
    """Why what was made of files of one stamp is made anew of files of another, in words; empty where it may stay, as
    what says nothing of its files does."""
    return CHANGED if was and now and was != now else ""


def tell_anew(anew: Mapping[str, str], *, by: str) -> None:
    """Says of which frames what is there will be made anew, and why: the reasons by the frames' names."""
    for why in sorted({*anew.values()}):
        names = [name for name, one in anew.items() if one == why]
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        _log.warning(f"{by}: {names[0]}{more} made anew: {why}")
