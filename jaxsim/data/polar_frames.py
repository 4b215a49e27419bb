"""Polar frames on disk: a folder with `grid.json` and one `NAME.npz` a frame.

The format is docs/polar-frames.md: any simulator can write it. Zero range means no return in the file; on
reading it becomes the mask.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.atomic import replacing
from jaxsim.frame import PolarGrid, PolarImage

REQUIRED = ("range", "intensity")


def write_grid(folder: Path | str, grid: PolarGrid, *, frames: dict[str, dict[str, Any]] | None = None) -> None:
    """Writes `grid.json`; `frames` maps a frame's name to any of time (s), speed (m/s), heading (rad), scene."""
    content = {
        "azimuth": np.asarray(grid.azimuth_rad, float).round(9).tolist(),
        "elevation": np.asarray(grid.elevation_rad, float).round(9).tolist(),
        "origin": np.asarray(grid.origin_m, float).round(6).tolist(),
        "frames": frames or {},
    }
    with replacing(Path(folder) / "grid.json") as path:
        path.write_text(json.dumps(content))


def read_grid(folder: Path | str) -> tuple[PolarGrid, dict[str, dict[str, Any]]]:
    """The grid of a folder and what it says of its frames. Raises ValueError where the file is not a grid."""
    path = Path(folder) / "grid.json"
    if not path.is_file():
        raise ValueError(f"polar frames: no grid.json in {folder}; a folder of polar frames has one beside NAME.npz")
    try:
        content = json.loads(path.read_text())
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"polar frames: {path} is not JSON ({error}); see docs/polar-frames.md") from error
    if not isinstance(content, dict) or not isinstance(content.get("frames", {}), dict):
        raise ValueError(
            f'polar frames: {path} must be {{"azimuth": [...], "elevation": [...], "frames": {{NAME: ...}}}}'
        )
    missing = [key for key in ("azimuth", "elevation") if key not in content]
    if missing:
        raise ValueError(f"polar frames: {path} lacks {', '.join(missing)} (radians, one a column / one a row)")
    azimuth, elevation = (_angles(path, name, content[name]) for name in ("azimuth", "elevation"))
    if (np.diff(azimuth) >= 0).any():
        raise ValueError(
            f"polar frames: {path}: azimuth must fall from column to column, from left to right as the camera sees the "
            "scene (atan2(y, x), x forward, y left; add 2 pi left of a window across the rear)"
        )
    origin = np.asarray(content.get("origin", np.zeros(len(elevation))), np.float32)
    grid = PolarGrid(azimuth, elevation, origin)
    return grid, content.get("frames", {})


def _angles(path: Path, name: str, given: Any) -> np.ndarray:
    try:
        angles = np.asarray(given, np.float32)
    except (TypeError, ValueError) as error:
        raise ValueError(f"polar frames: {path}: {name} must be a list of numbers in radians") from error
    if angles.ndim != 1 or angles.size < 2 or not np.isfinite(angles).all():
        raise ValueError(f"polar frames: {path}: {name} must be a list of two or more finite angles in radians")
    if np.abs(angles).max() > 4 * np.pi:
        raise ValueError(
            f"polar frames: {path}: {name} spans {angles.min():g}..{angles.max():g}; it must be in radians, not degrees"
        )
    return angles


def frame_names(folder: Path | str) -> list[str]:
    """Names of a folder's frames, sorted."""
    return sorted(path.stem for path in Path(folder).glob("*.npz"))


def write_frame(folder: Path | str, name: str, image: PolarImage, **more: Any) -> Path:
    """Writes one frame; `more` are further rasters by the names of the format (semantic, instance, rgb, ...)."""
    valid = np.asarray(image.valid)
    arrays = {
        "range": np.where(valid, np.asarray(image.range_m), 0).astype(np.float32),
        "intensity": np.where(valid, np.asarray(image.intensity), 0).astype(np.float32),
        **{key: np.asarray(value) for key, value in more.items()},
    }
    target = Path(folder) / f"{name}.npz"
    with replacing(target) as path:
        np.savez_compressed(path, **arrays)
    return target


def read_frame(folder: Path | str, name: str) -> tuple[PolarImage, dict[str, np.ndarray]]:
    """One frame and its further rasters. Raises ValueError on missing arrays, wrong shapes or wrong units."""
    path = Path(folder) / f"{name}.npz"
    try:
        with path.open("rb") as file, np.load(file) as archive:
            arrays = dict(archive)
    except (zipfile.BadZipFile, EOFError, ValueError, OSError) as error:
        raise ValueError(f"polar frames: {path} is no readable .npz ({error}); write it again") from error
    missing = [key for key in REQUIRED if key not in arrays]
    if missing:
        raise ValueError(f"polar frames: {path} lacks {', '.join(missing)}; it has {', '.join(arrays) or 'nothing'}")
    range_m, intensity = (np.asarray(arrays.pop(key), np.float32) for key in REQUIRED)
    if range_m.shape != intensity.shape:
        raise ValueError(
            f"polar frames: {path}: range is {range_m.shape}, intensity {intensity.shape}; both must be (rows, columns)"
        )
    if not np.isfinite(range_m).all() or (range_m < 0).any():
        raise ValueError(f"polar frames: {path}: range must be finite metres, 0 where nothing returned")
    if not np.isfinite(intensity).all() or intensity.min(initial=0) < 0 or intensity.max(initial=0) > 1:
        low, high = intensity.min(), intensity.max()
        raise ValueError(
            f"polar frames: {path}: intensity spans {low:g}..{high:g}; it must lie in 0..1 "
            "(divide by your sensor's scale)"
        )
    return PolarImage(range_m, intensity, range_m > 0), arrays
