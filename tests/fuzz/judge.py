"""Which column an outcome falls into."""

from __future__ import annotations

import dataclasses
import hashlib
import re
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.reader import Reader

GOOD = ("same", "different but sane", "own clear error")
BAD = ("implausible accepted", "bare foreign text", "raw traceback", "memory", "hang")
COLUMNS = (*GOOD, *BAD)
MACHINE = 2**37
"""Bytes; more than the memory of the machines that jaxsim is meant for."""
PACKAGE = str(Path(__file__).parents[2] / "jaxsim")


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The values of a tree of structs, dicts and sequences, each with the name of the field that holds it."""
    if isinstance(value, Mapping):
        for key in sorted(value, key=str):
            yield f"{name}/key", key
            yield from leaves(value[key], str(key).rpartition("/")[2])
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            yield from leaves(getattr(value, field.name), field.name)
    elif isinstance(value, list | tuple | set):
        yield f"{name}/length", len(value)
        for one in value:
            yield from leaves(one, name)
    else:
        yield name, value


def digest(value: Any) -> str:
    """The same for equal values alone."""
    total = hashlib.sha256()
    for name, leaf in leaves(value):
        if hasattr(leaf, "shape"):
            array = np.asarray(leaf)
            total.update(f"{name}{array.dtype}{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
        else:
            total.update(f"{name}{type(leaf).__name__}{leaf!r}".encode())
    return total.hexdigest()


def fault(value: Any, reader: Reader) -> str | None:
    """What cannot be right about a value that was read; None for a sane one."""
    for name, leaf in leaves(value):
        numeric = isinstance(leaf, int | float) or (hasattr(leaf, "dtype") and np.asarray(leaf).dtype.kind in "iuf")
        if not numeric or isinstance(leaf, bool) or name.endswith("/length"):
            continue
        try:
            array = np.asarray(leaf, np.float64)
        except OverflowError:
            return f"{name} is an integer that no number holds"
        if not array.size:
            continue
        low, high = reader.within.get(name, (-reader.largest, reader.largest))
        if not np.isfinite(array).all():
            return f"{name} is not finite"
        if array.min() < low or array.max() > high:
            return f"{name} spans {array.min():g}..{array.max():g}, beyond {low:g}..{high:g}"
    return None


def of_error(error: BaseException, folder: Path) -> str:
    """The column of an error: its text must name a file of the folder, and be ours or the system's."""
    chain: list[BaseException] = []
    at: BaseException | None = error
    while at is not None and len(chain) < 20:
        chain.append(at)
        at = at.__cause__ or at.__context__
    if any(isinstance(one, MemoryError) and not _beyond_any(one) for one in chain):
        return "memory"
    if not isinstance(error, ValueError | OSError | ModuleNotFoundError):
        return "raw traceback"
    frames = traceback.extract_tb(error.__traceback__)
    ours = bool(frames) and frames[-1].filename.startswith(PACKAGE)
    system = isinstance(error, OSError) and error.strerror is not None
    named = str(folder) in str(error)
    return "own clear error" if named and (ours or system) else "bare foreign text"


def _beyond_any(error: MemoryError) -> bool:
    """Whether it asked for more than a machine has: that is refused at once, and takes nothing."""
    return any(int(size) > MACHINE for size in re.findall(r"\d+", str(error)))
