"""Labelled range images: one NAME.npz a scan, whose `scan` holds x, y, z, intensity, range and class of each cell.

This is the form in which SqueezeSeg and its successors keep spherical projections of SemanticKITTI and nuScenes: rows
are laser lines from the top down, columns azimuths, and a cell of range 0 has no return. Class 0 is unlabelled. A
classes.json beside them may name the classes: ["unlabelled", "road", ...].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.files import files_in, parse_json, read_arrays, read_text
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
    scale = EIGHT_BITS if max(float(scan[..., 3].max()) for scan in scans.values()) > 1 else 1.0
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


def intensity_scale(files: Sequence[Path]) -> float:
    """What becomes intensity 1 in these files: 255 where one is beyond 1 anywhere."""
    return EIGHT_BITS if any(float(_scan(path)[..., 3].max()) > 1 for path in files) else 1.0


def read_range_image(path: Path, scale: float) -> RangeImage:
    """One scan, its intensities divided by `scale`. Raises ValueError as `read_range_images`."""
    return _image(path.stem, _scan(path), scale)


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
