"""Labelled range images: one NAME.npz a scan, whose `scan` holds x, y, z, intensity, range and class of each cell.

This is the form in which SqueezeSeg and its successors keep spherical projections of SemanticKITTI and nuScenes: rows
are laser lines from the top down, columns azimuths, and a cell of range 0 has no return. Class 0 is unlabelled. A
classes.json beside them may name the classes: ["unlabelled", "road", ...].

As a log its rows are bins of elevation more than beams, for the car's motion was taken out: name the sensor
(--log.sensor).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.data.cityscapes import IDS
from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source
from jaxsim.data.point_labels import LEARNING_CLASSES
from jaxsim.files import array_names, files_in, parse_json, read_arrays, read_text
from jaxsim.geometry.points import FAR_M

CLASSES_FILE = "classes.json"
CELL_FIELDS = ("x", "y", "z", "intensity", "range", "label")
EIGHT_BITS = 255.0
MOST_CLASSES = 256


@dataclass(frozen=True)
class RangeImage:
    """One scan."""

    name: str
    xyz_m: Float[np.ndarray, "rows columns 3"]
    range_m: Float[np.ndarray, "rows columns"]
    intensity: Float[np.ndarray, "rows columns"]
    """0..1."""
    label: Int[np.ndarray, "rows columns"]
    """0 is unlabelled."""
    valid: Bool[np.ndarray, "rows columns"]
    """Something came back."""


def range_image_files(folder: Path) -> list[Path]:
    """The files of a folder. Raises ValueError where there is none."""
    files = files_in(folder, ".npz")
    if not files:
        raise ValueError(
            f"range images: no NAME.npz in {folder}; expected files whose `scan` is (rows, columns, 6): "
            f"{', '.join(CELL_FIELDS)}"
        )
    return files


def read_range_images(folder: Path) -> list[RangeImage]:
    """All scans of a folder, by name. Intensities beyond 1 anywhere are taken as 0..255 everywhere.

    Raises ValueError where there is none, where sizes differ, and for values that cannot be.
    """
    scans = {path.stem: _scan(path) for path in range_image_files(folder)}
    sizes = {scan.shape[:2] for scan in scans.values()}
    if len(sizes) > 1:
        raise ValueError(f"range images: {folder} holds images of {sorted(sizes)} cells; keep each sensor in a folder")
    scale = _full_scale(scans.values())
    return [_image(name, scan, scale) for name, scan in scans.items()]


def class_names(folder: Path, classes: int) -> tuple[str, ...]:
    """Names of so many classes, by number: those of the folder's classes.json, else `class 1` and so on.

    Raises ValueError where the file names fewer, or is no list of names.
    """
    path = folder / CLASSES_FILE
    if not path.is_file():
        return tuple(f"class {number}" for number in range(classes))
    names = parse_json(read_text(path, by="range images"))
    if not isinstance(names, list) or len(names) < classes or not all(isinstance(name, str) for name in names):
        raise ValueError(
            f'range images: {path} must be a list of names, ["unlabelled", "road", ...], one for each of the {classes} '
            "classes that the images hold"
        )
    return tuple(names)


def _full_scale(scans: Iterable[Float[np.ndarray, "rows columns 6"]]) -> float:
    """What becomes intensity 1 in these scans: 255 where one is beyond 1 anywhere."""
    return EIGHT_BITS if any(float(scan[..., 3].max()) > 1 for scan in scans) else 1.0


def _scan(path: Path) -> Float[np.ndarray, "rows columns 6"]:
    arrays = read_arrays(path, ("scan",), by="range images")
    if "scan" not in arrays:
        raise ValueError(f"range images: {path} has no array `scan`: (rows, columns, 6): {', '.join(CELL_FIELDS)}")
    scan = np.asarray(arrays["scan"])
    if scan.ndim != 3 or scan.shape[2] != len(CELL_FIELDS) or scan.dtype.kind not in "fiu" or not scan.size:
        raise ValueError(
            f"range images: scan in {path} is {scan.dtype} of {scan.shape}; expected numbers of (rows, columns, 6): "
            f"{', '.join(CELL_FIELDS)}"
        )
    scan = scan.astype(np.float32)
    if not np.isfinite(scan).all():
        raise ValueError(f"range images: scan in {path} holds NaN or infinity; a cell without a return has range 0")
    intensity, away, label = np.moveaxis(scan[..., 3:6], -1, 0)
    if away.min() < 0 or intensity.min() < 0 or intensity.max() > EIGHT_BITS:
        raise ValueError(f"range images: scan in {path} has negative ranges, or intensities outside 0..1 and 0..255")
    if max(away.max(), np.abs(scan[..., :3]).max()) > FAR_M:
        raise ValueError(
            f"range images: scan in {path} reaches {max(away.max(), np.abs(scan[..., :3]).max()):g}; it must be in "
            f"metres, and no LiDAR sees beyond {FAR_M:g} m"
        )
    if (label != np.round(label)).any() or label.min() < 0 or label.max() >= MOST_CLASSES:
        raise ValueError(f"range images: scan in {path} has labels that are no classes 0..{MOST_CLASSES - 1}")
    return scan


def _image(name: str, scan: Float[np.ndarray, "rows columns 6"], scale: float) -> RangeImage:
    valid = scan[..., 4] > 0
    return RangeImage(
        name=name,
        xyz_m=np.where(valid[..., None], scan[..., :3], np.float32(0)),
        range_m=np.where(valid, scan[..., 4], np.float32(0)),
        intensity=np.where(valid, scan[..., 3] / np.float32(scale), np.float32(0)),
        label=np.where(valid, scan[..., 5], np.float32(0)).astype(np.int32),
        valid=valid,
    )


def range_image_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """The images of a folder, each a scene of its own, or one file."""
    files = [path] if path.is_file() else range_image_files(path)
    ids = class_ids(options.classes)
    read = partial(_read, scale=options.full_scale or _full_scale(map(_scan, files)), ids=ids)
    for file in files:
        yield Item(file.stem, partial(read, file), (file,))


def class_ids(text: str) -> Int[np.ndarray, " 256"] | None:
    """Cityscapes ids by the number of a class, -1 for numbers without one; None for "". Raises ValueError for what is
    no class."""
    if not text:
        return None
    ids = np.full(MOST_CLASSES, -1, np.int32)
    if text == "semantickitti":
        ids[: len(LEARNING_CLASSES)] = [IDS[name] for name in LEARNING_CLASSES]
        return ids
    for pair in text.split(","):
        number, _, name = pair.partition(":")
        if not number.strip().isdecimal() or int(number) >= MOST_CLASSES or name.strip() not in IDS:
            raise ValueError(
                f"range images: --log.classes has {pair!r}; write semantickitti, or pairs of a number and a class, "
                f"0:road,2:building; known: {', '.join(IDS)}"
            )
        ids[int(number)] = IDS[name.strip()]
    return ids


def _read(file: Path, *, scale: float, ids: np.ndarray | None) -> LogScan:
    image = _image(file.stem, _scan(file), scale)
    layers: dict[str, np.ndarray] = {}
    if ids is not None:
        if strange := sorted({*np.unique(image.label[image.valid]).tolist()} - {*np.flatnonzero(ids >= 0).tolist()}):
            raise ValueError(
                f"range images: {file} has class {', '.join(map(str, strange[:6]))}, which --log.classes does not "
                "name; add it (NUMBER:unlabeled where it means nothing)"
            )
        layers["semantic"] = np.where(image.valid, ids[image.label], 0).astype(np.int32).ravel()
    return LogScan(
        name=image.name,
        scene=image.name,
        xyz_m=image.xyz_m.reshape(-1, 3).astype(np.float32),  # at the origin where nothing came back
        intensity=image.intensity.ravel(),
        full_scale=1.0,
        columns=image.range_m.shape[1],
        layers=layers,
    )


def _takes(path: Path) -> bool:
    files = (
        [path] if path.suffix.lower() == ".npz" and path.is_file() else files_in(path, ".npz") if path.is_dir() else []
    )
    return bool(files) and "scan" in array_names(files[0], by="range images")


SOURCES: dict[str, Source] = {
    "range_images": Source("range images: NAME.npz of x y z intensity range label", _takes, range_image_items)
}
