"""Polar frames on disk: a folder with `grid.json` and one `NAME.npz` a frame.

The format is docs/polar-frames.md: any simulator can write it. Zero range means no return in the file; on
reading it becomes the mask. To a folder that frames are added to, `Announced` writes grid.json often, and in all as
seldom as the growing file asks for.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.data.polar_checks import SEE, SHAPES, angles_of, beam_origins, check_about, check_arrays
from jaxsim.files import (
    array_names,
    check_keys,
    file_of,
    files_in,
    read_arrays,
    read_json,
    replacing,
    why_anew,
    write_text,
)
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry import same_grid

REQUIRED = ("range", "intensity")
KEYS = ("azimuth", "elevation", "origin", "frames")
"""Keys of a grid.json."""
WRITING_SHARE = 0.05
"""Of the time that writing may take: grid.json of 100 000 frames has 10 MB, and a batch more would write all of it."""


def write_grid(folder: Path | str, grid: PolarGrid, *, frames: dict[str, dict[str, Any]] | None = None) -> None:
    """Writes `grid.json`; `frames` maps a frame's name to any of time (s), speed (m/s), heading (rad),
    scene, tags (list of words)."""
    content = {
        "azimuth": np.asarray(grid.azimuth_rad, float).round(9).tolist(),
        "elevation": np.asarray(grid.elevation_rad, float).round(9).tolist(),
        "origin": np.asarray(grid.origin_m, float).round(6).tolist(),
        "frames": frames or {},
    }
    write_text(Path(folder) / "grid.json", json.dumps(content))


def read_grid(folder: Path | str) -> tuple[PolarGrid, dict[str, dict[str, Any]]]:
    """The grid of a folder and what it says of its frames.

    Raises ValueError where the file is not a grid, angles do not fall (from left to right, from the top beam down: the
    effects that cast rays again look their cell up in them), or an entry of a frame cannot be right.
    """
    path = Path(folder) / "grid.json"
    if not path.is_file():
        raise ValueError(f"polar frames: no grid.json in {folder}; a folder of polar frames has one beside NAME.npz")
    content = read_json(path, by="polar frames", hint=SEE)
    if not isinstance(content, dict) or not isinstance(content.get("frames", {}), dict):
        raise ValueError(
            f'polar frames: {path} must be {{"azimuth": [...], "elevation": [...], "frames": {{NAME: ...}}}}'
        )
    missing = [key for key in ("azimuth", "elevation") if key not in content]
    if missing:
        raise ValueError(f"polar frames: {path} lacks {', '.join(missing)} (radians, one a column / one a row)")
    check_keys(content, KEYS, where=f"polar frames: {path}")
    azimuth = angles_of(path, "azimuth", content["azimuth"])
    elevation = angles_of(path, "elevation", content["elevation"])
    origin = beam_origins(path, content.get("origin", [0.0] * len(elevation)), len(elevation))
    frames = content.get("frames", {})
    check_about(path, frames)
    return PolarGrid(azimuth, elevation, origin), frames


def frame_names(folder: Path | str) -> list[str]:
    """Names of a folder's frames, sorted."""
    return [path.stem for path in files_in(folder, ".npz")]


def write_frame(folder: Path | str, name: str, image: PolarImage, **more: Any) -> None:
    """Writes one frame; `more` are further rasters by the names of the format (semantic, instance, rgb, ...), and
    `source` a text, the stamp of what it is made of (`frame_anew`)."""
    valid = np.asarray(image.valid)
    arrays = {
        "range": np.where(valid, np.asarray(image.range_m), 0).astype(np.float32),
        "intensity": np.where(valid, np.asarray(image.intensity), 0).astype(np.float32),
        **{key: np.asarray(value) for key, value in more.items()},
    }
    with replacing(file_of(folder, name, ".npz", by="polar frames")) as path:
        np.savez_compressed(path, **arrays)


def frame_anew(folder: Path | str, name: str, source: str) -> str:
    """Why a frame that is there is to be made anew, in words: its file is no archive, as one that is cut off, or
    `source`, the stamp of what it is made of, is not the one that it was written with. Empty where it may stay."""
    try:
        held = read_arrays(file_of(folder, name, ".npz", by="polar frames"), ("source",), by="polar frames")
    except ValueError:
        return "its file is cut off or damaged"
    return why_anew(str(held.get("source", "")), source)


def read_frame(folder: Path | str, name: str) -> tuple[PolarImage, dict[str, np.ndarray]]:
    """One frame and its further rasters. Raises ValueError on missing arrays, wrong types, shapes or units."""
    path = Path(folder) / f"{name}.npz"
    arrays = read_arrays(path, SHAPES, by="polar frames", again="write it again")
    missing = [key for key in REQUIRED if key not in arrays]
    if missing:
        present = ", ".join(array_names(path, by="polar frames")) or "nothing"
        raise ValueError(f"polar frames: {path} lacks {', '.join(missing)}; it has {present}")
    check_arrays(path, arrays)
    range_m = np.asarray(arrays.pop("range"), np.float32)
    intensity = np.asarray(arrays.pop("intensity"), np.float32)
    return PolarImage(range_m, intensity, range_m > 0), arrays


@dataclass(frozen=True)
class PolarFrames:
    """A folder of polar frames, read when asked for."""

    folder: Path
    grid: PolarGrid
    about: dict[str, dict[str, Any]]
    """What grid.json says of the frames, by name."""
    names: tuple[str, ...]

    def read(self, name: str) -> tuple[PolarImage, dict[str, np.ndarray]]:
        """One frame and its further rasters. Raises ValueError as `read_frame`, and where it is not on the grid."""
        image, rasters = read_frame(self.folder, name)
        shape = len(self.grid.elevation_rad), len(self.grid.azimuth_rad)
        if image.range_m.shape != shape:
            raise ValueError(f"polar frames: {self.folder / name}.npz is {image.range_m.shape}, its grid.json {shape}")
        return image, rasters


def scene_of(name: str, *sides: PolarFrames) -> str:
    """The scene of a frame, by the first side that tells one; its own name where none does."""
    return next((str(side.about[name]["scene"]) for side in sides if "scene" in side.about.get(name, {})), name)


def about_frame(
    scene: str, *, time_s: float | None = None, speed_mps: float | None = None, heading_rad: float | None = None
) -> dict[str, Any]:
    """What grid.json says of a frame: its scene, and its time, speed and heading where they are known."""
    motion = {"time": time_s, "speed": speed_mps, "heading": heading_rad}
    return {"scene": scene} | {name: value for name, value in motion.items() if value is not None}


def open_polar_frames(folder: Path | str) -> PolarFrames:
    """A folder of polar frames with its grid. Raises ValueError as `read_grid`, and where it holds no frames."""
    grid, about = read_grid(folder)
    names = frame_names(folder)
    if not names:
        raise ValueError(f"polar frames: no frames (NAME.npz) in {folder}")
    return PolarFrames(Path(folder), grid, about, tuple(names))


class Announced:
    """What a folder's grid.json says of its frames, by name.

    A frame that it does not name yet is not done, though its file may be there: a killed command makes those of the
    last seconds anew. As a context it writes down all of them at its end, those of `order` last and in this order.
    `by` is who writes them. Raises ValueError where the folder is of another grid.
    """

    def __init__(self, folder: Path, grid: PolarGrid, *, order: Sequence[str] = (), by: str = "simulate"):
        self.folder = folder
        self.grid = grid
        self.order = order
        self.frames: dict[str, dict[str, Any]] = {}
        self.pending = False
        self._next_s = 0.0
        if (folder / "grid.json").is_file():
            old, self.frames = read_grid(folder)
            if not same_grid(old, grid):
                raise ValueError(
                    f"{by}: {folder} holds frames of another grid ("
                    f"{len(old.elevation_rad)} x {len(old.azimuth_rad)} cells; these have {len(grid.elevation_rad)} x "
                    f"{len(grid.azimuth_rad)}); give another --out"
                )

    def __enter__(self) -> Announced:
        return self

    def __exit__(self, *error: object) -> None:
        # However they came: the file of a killed or a spread command is that of any other.
        asked = {*self.order}
        others = {name: about for name, about in self.frames.items() if name not in asked}
        ordered = others | {name: self.frames[name] for name in self.order if name in self.frames}
        self.pending |= [*ordered] != [*self.frames]
        self.frames = ordered
        self.write()

    def add(self, about: Mapping[str, dict[str, Any]]) -> None:
        """Adds frames, by name; they are written down now, or within the time that WRITING_SHARE gives."""
        self.frames |= about
        self.pending = True
        if time.monotonic() >= self._next_s:
            self.write()

    def remove(self, name: str) -> None:
        """Removes a frame and what is said of it, where it is there."""
        file_of(self.folder, name, ".npz", by="polar frames").unlink(missing_ok=True)
        self.pending |= self.frames.pop(name, None) is not None

    def write(self) -> None:
        """Writes down what is not yet."""
        if not self.pending:
            return
        begun = time.monotonic()
        write_grid(self.folder, self.grid, frames=self.frames)
        ended = time.monotonic()
        self.pending, self._next_s = False, ended + (ended - begun) / WRITING_SHARE
