"""What becomes of a file: its bytes, its arrays, or the file itself."""

from __future__ import annotations

import io
import os
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.texts import JSON, TEXT

Rng = np.random.Generator
Mutation = Callable[[bytes, Rng], bytes]


def _place(data: bytes, rng: Rng) -> int:
    return int(rng.integers(0, max(len(data), 1)))


def _truncated(data: bytes, rng: Rng) -> bytes:
    return data[: _place(data, rng)]


def _truncated_at_a_border(data: bytes, rng: Rng) -> bytes:
    """Cut where a record of 16, 20 or 64 bytes ends, or behind a line."""
    step = int(rng.choice([16, 20, 64]))
    return data[: _place(data, rng) // step * step]


def _bit(data: bytes, rng: Rng, count: int = 1) -> bytes:
    out = bytearray(data)
    for _ in range(count if out else 0):
        out[_place(data, rng)] ^= 1 << int(rng.integers(0, 8))
    return bytes(out)


def _bits(data: bytes, rng: Rng) -> bytes:
    return _bit(data, rng, 20)


def _swapped(data: bytes, rng: Rng) -> bytes:
    a, b, c = sorted(_place(data, rng) for _ in range(3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def _overwritten(data: bytes, rng: Rng) -> bytes:
    """A stretch of zeros, ones or noise: a bad block of a disk."""
    at, n = _place(data, rng), int(rng.integers(1, 512))
    fill = [bytes(n), b"\xff" * n, rng.bytes(n)][int(rng.integers(0, 3))]
    return data[:at] + fill[: len(data) - at] + data[at + n :]


def _inserted(data: bytes, rng: Rng) -> bytes:
    at = _place(data, rng)
    return data[:at] + rng.bytes(int(rng.integers(1, 40))) + data[at:]


def _doubled(data: bytes, rng: Rng) -> bytes:
    return data + data


def _other_file(data: bytes, rng: Rng) -> bytes:
    """Some other kind of file under this name."""
    return _OTHERS[int(rng.integers(0, len(_OTHERS)))] + rng.bytes(50)


_OTHERS = (
    *(b"", b"\n", b"\x89PNG\r\n\x1a\n", b"\x1f\x8b", b"PK\x03\x04", b"<html>404</html>", b"\x7fELF", b"\x80\x04N."),
    b"version https://git-lfs.github.com/spec/v1\n",
)


def _float(data: bytes, rng: Rng) -> bytes:
    """One of a file of float32 becomes NaN, infinite, huge, negative."""
    at = _place(data, rng) // 4 * 4
    value = [np.nan, np.inf, -np.inf, 1e30, -5.0, 1e6, 3e-39][int(rng.integers(0, 7))]
    return data[:at] + struct.pack("<f", value) + data[at + 4 :]


def _huge_picture(data: bytes, rng: Rng) -> bytes:
    """A PNG whose header promises 40000 x 40000."""
    head = struct.pack(">II", 40000, 40000) + data[24:29]
    return data[:16] + head + struct.pack(">I", zlib.crc32(data[12:16] + head)) + data[33:]


BYTES: tuple[Mutation, ...] = (
    _truncated,
    _truncated_at_a_border,
    _bit,
    _bits,
    _swapped,
    _overwritten,
    _inserted,
    _doubled,
    _other_file,
)


def _arrays(data: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(data)) as archive:
        return dict(archive)


def _saved(arrays: dict[str, Any]) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def _of_one(change: Callable[[np.ndarray, Rng], Any]) -> Mutation:
    """A mutation of one of the arrays, the archive around it being whole."""

    def mutate(data: bytes, rng: Rng) -> bytes:
        arrays = _arrays(data)
        name = sorted(arrays)[int(rng.integers(0, len(arrays)))]
        return _saved(arrays | {name: change(arrays[name], rng)})

    mutate.__name__ = change.__name__
    return mutate


def _poisoned(array: np.ndarray, rng: Rng) -> np.ndarray:
    if array.dtype.kind != "f" or not array.size:
        return array
    out = array.copy()
    out.flat[int(rng.integers(0, out.size))] = [np.nan, np.inf, 1e30, -7.0][int(rng.integers(0, 4))]
    return out


def _scaled(array: np.ndarray, rng: Rng) -> np.ndarray:
    return array * array.dtype.type(1000) if array.dtype.kind == "f" else array


def _retyped(array: np.ndarray, rng: Rng) -> Any:
    kind = ["f8", "i8", "c16", "?", "U9", "S9", "O", "f2", ">f4", "M8[s]"][int(rng.integers(0, 10))]
    with np.errstate(all="ignore"):
        try:
            return array.astype(kind)
        except (ValueError, TypeError):
            return np.array("text")


def _reshaped(array: np.ndarray, rng: Rng) -> np.ndarray:
    some = array if array.ndim else array[None]
    options = (array.T, array.ravel(), array[None], some[:0], np.array(0.0), some[..., :-1])
    return options[int(rng.integers(0, len(options)))]


def _lost(data: bytes, rng: Rng) -> bytes:
    arrays = _arrays(data)
    arrays.pop(sorted(arrays)[int(rng.integers(0, len(arrays)))])
    return _saved(arrays)


def _more(data: bytes, rng: Rng) -> bytes:
    return _saved(_arrays(data) | {["extra", "range_m", "a/../b", "Intensity"][int(rng.integers(0, 4))]: np.ones(3)})


def _promising(data: bytes, rng: Rng) -> bytes:
    """A member whose header promises 4 TiB, or whose directory entry lies of its size."""
    source, out = zipfile.ZipFile(io.BytesIO(data)), io.BytesIO()
    chosen = source.namelist()[int(rng.integers(0, len(source.namelist())))]
    with zipfile.ZipFile(out, "w") as target:
        for name in source.namelist():
            member = source.read(name)
            if name == chosen:
                head = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1099511627776,), }"
                head = head.ljust(118 - 1) + b"\n"
                member = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(64)
            target.writestr(name, member)
    return out.getvalue()


def _bomb(data: bytes, rng: Rng) -> bytes:
    """A member of 2.25 GiB of zeros in 10 MB: one that the reader knows, or another."""
    source = _arrays(data)
    known = bool(rng.integers(0, 2))
    name = sorted(source)[int(rng.integers(0, len(source)))] if known else "extra"
    out = io.BytesIO(_saved({key: value for key, value in source.items() if key != name}))
    head = b"{'descr': '<f4', 'fortran_order': False, 'shape': (603979776,), }".ljust(117) + b"\n"
    target = zipfile.ZipFile(out, "a", zipfile.ZIP_DEFLATED, compresslevel=1)
    with target, target.open(f"{name}.npy", "w", force_zip64=True) as member:
        member.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head)
        for _ in range(36):
            member.write(bytes(1 << 26))
    return out.getvalue()


ARRAYS: tuple[Mutation, ...] = (
    _of_one(_poisoned),
    _of_one(_poisoned),
    _of_one(_scaled),
    _of_one(_retyped),
    _of_one(_reshaped),
    _lost,
    _more,
    _promising,
)


def _directory(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _dangling(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def _looped(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _leftover(path: Path) -> None:
    """What a killed writer leaves beside a file."""
    shutil.copy(path, path.with_name(f".4711.{path.name}"))
    with path.with_name(f".4711.{path.name}").open("r+b") as file:
        file.truncate(path.stat().st_size // 2)


FILES: tuple[Callable[[Path], None], ...] = (Path.unlink, _directory, _dangling, _looped, _pipe, _leftover)


def mutate(path: Path, rng: Rng) -> str:
    """Changes one file and gives the mutation's name. Archives, pictures, texts and JSON also get their own kinds."""
    data = path.read_bytes()
    kinds: list[Any] = [*BYTES, *BYTES]
    if path.suffix == ".npz":
        # A bomb takes seconds to make: one in eighty or so.
        kinds += [*ARRAYS, *ARRAYS] + [_bomb] * int(rng.integers(0, 3) == 0)
    elif data.startswith(b"\x89PNG"):
        kinds += [_huge_picture] * 2
    elif path.suffix in (".json", ".jsonl") or data[:1] in b"{[":
        kinds += [*JSON, *JSON, *TEXT]
    elif path.suffix == ".txt":
        kinds += [*TEXT, *TEXT]
    elif path.suffix == ".bin":
        kinds += [_float] * 6
    kinds += FILES
    chosen = kinds[int(rng.integers(0, len(kinds)))]
    if chosen in FILES:
        chosen(path)
    else:
        path.write_bytes(chosen(data, rng))
    return chosen.__name__.strip("_")
