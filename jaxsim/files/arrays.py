"""Arrays in .npz files: measured before they are unpacked, never unpickled, and compared with their own SHA-256."""

from __future__ import annotations

import hashlib
import io
import math
import struct
import threading
import warnings
import zipfile
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from jaxsim.files.whole import check_size, replacing

SUM = "sha256"
"""Name under which a file keeps the `digest` of its other arrays."""
MOST_UNPACKED = 256 * 2**20
"""Bytes that a small file may unpack to: 30 times the largest polar frame of a 128-beam sensor."""
_ONE_PARSER = threading.Lock()
"""NumPy reads an array's header by Python's parser, which in 3.11 fails now and then while another thread is in it, too
(SystemError, "AST constructor recursion depth mismatch"); trainings read from several threads."""
MOST_RATIO = 4
"""A larger one may unpack to so many times its size."""
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, KeyError, TypeError, ValueError),
    *(NotImplementedError, RuntimeError, SyntaxError, MemoryError, OverflowError, OSError),
)
"""What `zipfile` and NumPy raise where bytes are not theirs."""


def digest(arrays: Mapping[str, Any]) -> str:
    """SHA-256 of names, types, shapes and values, in the order of the names."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def digest_of_values(arrays: Iterable[Any], *, after: str = "") -> str:
    """SHA-256 of arrays' values alone, in their order, after a text."""
    total = hashlib.sha256(after.encode())
    for array in arrays:
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


def write_arrays(path: Path | str, arrays: Mapping[str, Any]) -> None:
    """Writes a .npz, whole or not at all, with the digest of what it holds."""
    plain: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items()}
    plain[SUM] = np.array(digest(plain))
    with replacing(path) as temporary:
        np.savez(temporary, **plain)


def read_arrays(
    path: Path | str,
    names: Collection[str] | None = None,
    *,
    by: str,
    again: str = "copy it again",
    summed: bool = False,
    most: int = MOST_UNPACKED,
) -> dict[str, np.ndarray]:
    """The arrays of a .npz, or those of `names` that it has: others are not unpacked.

    Where all are read and the file keeps their digest, they are compared with it; a file that should (`summed`) and was
    written before files did is taken with a warning. `by` names who reads, `again` says what to do with a damaged file.

    Raises ValueError where it cannot be read, does not hold plain arrays, would unpack to more than `most` bytes and
    MOST_RATIO times its size, or differs from its digest.
    """
    path = Path(path)
    size = check_size(path, by=by)
    with _opened(path, by=by, again=again) as archive:
        wanted = {name: info for name, info in _members(archive).items() if names is None or name in names}
        unpacked = sum(info.file_size for info in wanted.values())
        if unpacked > max(most, MOST_RATIO * size):
            raise ValueError(f"{size} bytes that would unpack to {unpacked}: not what it says it is")
        arrays = {name: _array(archive, info) for name, info in wanted.items()}
        if names is None:
            _compare(path, arrays, by=by, summed=summed)
    return arrays


def array_names(path: Path | str, *, by: str, again: str = "copy it again") -> list[str]:
    """Names of the arrays of a .npz, without reading any. Raises ValueError as `read_arrays`."""
    check_size(path, by=by)
    with _opened(Path(path), by=by, again=again) as archive:
        return [*_members(archive)]


@contextmanager
def _opened(path: Path, *, by: str, again: str = "copy it again") -> Iterator[zipfile.ZipFile]:
    """The archive; whatever is found to be wrong with it while it is read becomes a ValueError that names it."""
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except PermissionError:  # it may be whole
        raise
    except DAMAGED as error:
        raise ValueError(f"{by}: {path} is no readable .npz of plain arrays ({error}); {again}") from error


def _members(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """The archive's arrays by name. Raises ValueError for a name that comes twice: one would be passed over."""
    entries = [(info.filename.removesuffix(".npy"), info) for info in archive.infolist()]
    members = dict(entries)
    if len(members) < len(entries):
        raise ValueError("it holds two arrays of one name")
    return members


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """One array. Raises ValueError where its header promises more or less than the bytes that follow it.

    Reading the member to its end also compares it with the CRC-32 that the archive keeps.
    """
    content = io.BytesIO(archive.read(info))
    version = npy.read_magic(content)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"{info.filename} is a .npy of version {version[0]}.{version[1]}, not 1.0 or 2.0")
    with _ONE_PARSER:
        shape, _, dtype = (npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0)(content)
    if dtype.kind not in "biufcU":
        raise ValueError(f"{info.filename} holds {dtype}, not numbers or text")
    promised, stored = math.prod(shape) * dtype.itemsize, info.file_size - content.tell()
    if promised != stored:
        raise ValueError(f"{info.filename} promises {promised} bytes and has {stored}")
    content.seek(0)
    with _ONE_PARSER:
        return npy.read_array(content, allow_pickle=False)


def _compare(path: Path, arrays: dict[str, np.ndarray], *, by: str, summed: bool) -> None:
    """Takes the digest out of `arrays` and compares it with theirs."""
    recorded = arrays.pop(SUM, None)
    if recorded is None:
        if summed:
            warnings.warn(
                f"{by}: {path} was written without a SHA-256 by an earlier version; it is not verified", stacklevel=3
            )
    elif str(recorded) != digest(arrays):
        raise ValueError("its arrays differ from the SHA-256 that they were written with: the file is damaged")
