"""Published weights as plain arrays: PyTorch state dicts under their own names and layouts, in one .npz a network.

A converted file holds the state dict's arrays and, under `about`, a JSON text: the kind, the file it came from, that
file's SHA-256 and whether it is the one that was published.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.files import array_names, check_apart, check_size, parse_json, placed, read_arrays, write_arrays

Arrays = dict[str, np.ndarray]
Shapes = Mapping[str, tuple[int, ...]]
Values = dict[str, Any]
"""A network's parameters and statistics: nested dicts by published names."""
RUNNING = ("running_mean", "running_var")
"""What PyTorch calls the statistics that a batch norm keeps."""
ABOUT = "about"
AGAIN = "convert or copy it again"
MOST_BYTES = 2**30
"""Size of a network: the largest that is read, pix2pixHD's generator, has 730 MB."""


@dataclass(frozen=True)
class Converter:
    """How one kind of published weights becomes a file that jaxsim reads."""

    title: str
    """The network, and whose: `VGG-19 of torchvision`."""
    fetch: str
    """Address of the published file."""
    convert: Callable[[Arrays], Arrays]
    """State dict -> the arrays to keep. Raises ValueError where it is another network's."""
    digest: str = ""
    """First hexadecimal digits of the published file's SHA-256; empty where its publisher names none."""
    files: tuple[str, ...] = ()
    """Names of the state dicts, where they are published as a folder of several: their arrays are called
    `FILE.name`."""


@dataclass(frozen=True)
class Weights:
    """A converted file."""

    arrays: Arrays
    sha256: str
    """SHA-256 of names, shapes and values."""
    published: bool
    """They came from the very file that its publisher names."""


def read_state_dict(path: Path, files: tuple[str, ...] = ()) -> Arrays:
    """Arrays of a PyTorch checkpoint (nested dicts are joined by dots) or of a .npz of the same names.

    With `files`, `path` is the folder that holds them. Raises FileNotFoundError, and ValueError where a file is
    neither; ModuleNotFoundError where PyTorch is needed and missing.
    """
    if files:
        missing = [name for name in files if not (path / name).is_file()]
        if missing:
            raise FileNotFoundError(
                f"convert: {path} must be a folder that holds {', '.join(files)}; {', '.join(missing)} is missing"
            )
        parts = {name: read_state_dict(path / name) for name in files}
        return {f"{part}.{name}": array for part, arrays in parts.items() for name, array in arrays.items()}
    if not path.is_file():
        raise FileNotFoundError(f"convert: no file {path}")
    if path.suffix == ".npz":
        return _read_npz(path)
    try:
        import torch
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"convert: {path} is a PyTorch file, and PyTorch is not installed; pip install 'jaxsim-lidar[convert]', or "
            "save its arrays under their names in a .npz on a machine that has it"
        ) from error
    check_size(path, by="convert")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds, none of its own
        raise ValueError(f"convert: {path} is no PyTorch checkpoint of plain tensors ({error})") from error
    if not isinstance(content, Mapping):
        raise ValueError(f"convert: {path} holds a {type(content).__name__}, not a state dict (names -> tensors)")
    return dict(_named_tensors(content, torch.Tensor))


def _named_tensors(content: Mapping[Any, Any], tensor: type, prefix: str = "") -> Any:
    for name, value in content.items():
        if isinstance(value, tensor):
            yield f"{prefix}{name}", value.detach().cpu().numpy()  # type: ignore[attr-defined]
        elif isinstance(value, Mapping):
            yield from _named_tensors(value, tensor, f"{prefix}{name}.")


def _read_npz(path: Path, *, summed: bool = False) -> Arrays:
    return read_arrays(path, by="weights", again=AGAIN, summed=summed, most=MOST_BYTES)


def checked_arrays(arrays: Arrays, shapes: Shapes) -> Arrays:
    """The arrays of these names, float32; a prefix that all names share (`module.`) falls away.

    Raises ValueError that says which names are missing or have another shape, or hold what is no weight: text, truth
    values, NaN.
    """
    probe = next(iter(shapes))
    prefixes = {name[: -len(probe)] for name in arrays if name.endswith(f".{probe}")}
    prefix = prefixes.pop() if probe not in arrays and len(prefixes) == 1 else ""
    faults = []
    for name, shape in shapes.items():
        array = arrays.get(prefix + name)
        if array is None or array.shape != shape:
            faults.append(f"{name} is {'missing' if array is None else array.shape}, not {shape}")
        elif array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            what = array.dtype if array.dtype.kind not in "fiu" else "NaN or infinite numbers"
            faults.append(f"{name} holds {what}, not finite numbers")
    if faults:
        more = f"; and {len(faults) - 5} more" if len(faults) > 5 else ""
        unknown = [name for name in arrays if name.removeprefix(prefix) not in shapes and name != ABOUT]
        beside = f" It has {', '.join(unknown[:3])} ... instead." if unknown else ""
        raise ValueError(f"{'; '.join(faults[:5])}{more}.{beside}")
    return {name: np.asarray(arrays[prefix + name], np.float32) for name in shapes}


def kernel_of(array: np.ndarray, *, transposed: bool = False) -> np.ndarray:
    """A kernel as PyTorch has it, (out, in, rows, columns), as (rows, columns, in, out).

    That of a transposed convolution, (in, out, rows, columns) there, becomes one of a convolution: the taps reversed.
    """
    return array.transpose(2, 3, 0, 1)[::-1, ::-1] if transposed else array.transpose(2, 3, 1, 0)


def published_shape(shape: tuple[int, ...], *, transposed: bool = False) -> tuple[int, ...]:
    """The shape in PyTorch of an array that is a kernel, (rows, columns, in, out), where it has four axes."""
    if len(shape) != 4:
        return shape
    rows, columns, narrow, wide = shape
    return (narrow, wide, rows, columns) if transposed else (wide, narrow, rows, columns)


def convert(kind: str, converter: Converter, source: Path, *, out: Path) -> Weights:
    """Reads a published state dict, checks it and writes `out`.

    Raises ValueError for files that are no state dict and for weights of another network; it says what to fetch.
    """
    if out.suffix != ".npz":
        raise ValueError(f"convert: --out {out} must end in .npz")
    files = [source / name for name in converter.files] or [source]
    check_apart(out, *files, by="convert")
    with placed(f"convert: {source} cannot be read as {converter.title}", then=f"fetch {converter.fetch}"):
        arrays = read_state_dict(source, converter.files)
    with placed(f"convert: {source} is not {converter.title}", then=f"fetch {converter.fetch}"):
        converted = converter.convert(arrays)
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    published = bool(converter.digest) and digest.startswith(converter.digest)
    about = {"kind": kind, "source": source.name, "source_sha256": digest, "published": published}
    write_arrays(out, {**converted, ABOUT: np.array(json.dumps(about))})
    return Weights(converted, fingerprint(converted), published)


def load_weights(path: Path, kind: str, converter: Converter) -> Weights:
    """A file of this kind that `jaxsim convert` wrote.

    Raises FileNotFoundError or ValueError, which say how to get the right one.
    """
    help = f"fetch {converter.fetch}, then `jaxsim convert {kind} FILE --out {kind}.npz`"
    if not path.is_file():
        raise FileNotFoundError(f"weights: no {converter.title} at {path}; {help}")
    arrays = _read_npz(path, summed=ABOUT in array_names(path, by="weights", again=AGAIN))
    try:
        about = dict(parse_json(str(arrays.pop(ABOUT))))
    except (KeyError, ValueError, TypeError) as error:
        raise ValueError(f"weights: {path} was not written by `jaxsim convert`; {help}") from error
    if about.get("kind") != kind:
        raise ValueError(f"weights: {path} holds {about.get('kind')}, not {kind} ({converter.title}); {help}")
    with placed(f"weights: {path} is not {converter.title}", then=help):
        converted = converter.convert(arrays)
    return Weights(converted, fingerprint(converted), bool(about.get("published")))


def write_trained(path: Path, kind: str, arrays: Arrays) -> None:
    """Writes a network that was trained here as a file of this kind; the file is never half written."""
    about = json.dumps({"kind": kind, "source": "a training of jaxsim", "published": False})
    write_arrays(path, {**arrays, ABOUT: np.array(about)})


def weights_kind(path: Path) -> str | None:
    """The kind of a converted file; None for other files."""
    try:
        return parse_json(str(read_arrays(path, (ABOUT,), by="weights")[ABOUT])).get("kind")
    except (FileNotFoundError, KeyError, ValueError, AttributeError):
        return None


def fingerprint(arrays: Arrays) -> str:
    """SHA-256 of names, shapes and values."""
    # Not `files.digest`, which counts types too: this one names the statistics that users keep.
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(f"{name}{arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()
