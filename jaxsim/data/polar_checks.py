"""What a folder of polar frames may hold: each check names the file and the key, says what came and what is right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.files import check_keys, real
from jaxsim.geometry.points import FAR_M
from jaxsim.geometry.rasters import all_within, check_classes, span_in_words

SEE = "`jaxsim discover --help` tells the format"
LOW_ORIGIN_M = 10.0
"""Beams' origins lie within this of the cloud's: more is millimetres."""

SHAPES = {"range": 2, "intensity": 2, "incidence": 2, "semantic": 2, "instance": 2, "time": 2, "rgb": 3}
"""Dimensions of each raster of the format; rgb's third is its three channels."""
ABOUT_KEYS = ("scene", "time", "speed", "heading", "tags")
"""What grid.json may say of a frame."""
LATEST_S = 1e10
"""Seconds since 1970 in the year 2286: a time beyond is in another unit."""
INT32 = int(np.iinfo(np.int32).min), int(np.iinfo(np.int32).max)
ID_RASTERS = ("semantic", "instance")
"""Rasters of ids."""
FASTEST_MPS = 150.0
"""No car that carries a LiDAR drives faster: 540 km/h."""
UNEVEN = 0.5
"""Columns by which a column may lie off even spacing: half a column is where rays are looked up in the next one."""
STEEPEST_RAD = np.pi / 2 + 1e-3
"""Of a beam, and of the angle between a ray and a surface's normal: a right angle that may be rounded."""
TURNS_RAD = 4 * np.pi
"""A heading or a beam's angle beyond it is in degrees."""


def angles_of(path: Path, name: str, given: Any) -> Float[np.ndarray, " n"]:
    """`azimuth` or `elevation` of a grid.json. Raises ValueError where they cannot be that."""
    angles = _reals(given, f"polar frames: {path}: {name} must be a list of numbers in radians")
    if angles.ndim != 1 or angles.size < 2 or not np.isfinite(angles).all():
        raise ValueError(f"polar frames: {path}: {name} must be a list of two or more finite angles in radians")
    if np.abs(angles).max() > TURNS_RAD:
        raise ValueError(
            f"polar frames: {path}: {name} spans {angles.min():g}..{angles.max():g}; it must be in radians, not degrees"
        )
    rising = np.flatnonzero(np.diff(angles) >= 0)
    if rising.size and name == "azimuth":
        raise ValueError(
            f"polar frames: {path}: azimuth must fall from column to column, from left to right as the camera sees the "
            "scene (atan2(y, x), x forward, y left), and go on past -pi where a turn or a window across the rear does: "
            "subtract 2 pi from there on"
        )
    if name == "azimuth":
        # In steps, from where even spacing has each column: rays are looked up by it.
        off = np.abs(angles - np.linspace(angles[0], angles[-1], angles.size)) * (angles.size - 1)
        off /= angles[0] - angles[-1]
        if off.max() > UNEVEN:
            raise ValueError(
                f"polar frames: {path}: azimuth must be evenly spaced, and column {int(off.argmax())} lies "
                f"{off.max():.2g} columns off; sort the firings into even columns (`jaxsim frames` does)"
            )
        # Half a column of slack for azimuths that are rounded.
        width, turn = float(angles[0] - angles[-1]), 2 * np.pi
        if width > turn - width / (angles.size - 1) / 2:
            raise ValueError(
                f"polar frames: {path}: azimuth spans {width:.5f} rad from the first of {angles.size} columns to the "
                "last, which lies on the first or beyond; a turn's last column lies one step before its first: leave "
                "out the last column, here and in every array, where it is the first again"
            )
    elif np.abs(angles).max() > STEEPEST_RAD:
        raise ValueError(
            f"polar frames: {path}: elevation spans {angles.min():g}..{angles.max():g}; no beam looks beyond the "
            "zenith, pi/2, or the nadir, -pi/2: one across the vertical axis lies on the other side's azimuth"
        )
    if rising.size:
        k = int(rising[0])
        raise ValueError(
            f"polar frames: {path}: elevation must fall from row to row, top beam first, but row {k + 1} "
            f"({angles[k + 1]:.5f} rad) does not lie below row {k} ({angles[k]:.5f} rad); sort the beams by elevation, "
            "and the rows of every array with them"
        )
    return angles


def beam_origins(path: Path, given: Any, rows: int) -> Float[np.ndarray, " rows"]:
    """`origin` of a grid.json. Raises ValueError where it is not one height a row."""
    right = f"it must be a list of {rows} heights in metres, one a row, or be left out for 0"
    origin = _reals(given, f"polar frames: {path}: origin is {as_given(given)}; {right}")
    if origin.shape != (rows,):
        came = f"a list of {origin.size} numbers" if origin.ndim == 1 else as_given(given)
        raise ValueError(f"polar frames: {path}: origin is {came}; {right}")
    if not np.isfinite(origin).all() or np.abs(origin).max() > LOW_ORIGIN_M:
        raise ValueError(
            f"polar frames: {path}: origin spans {origin.min():g}..{origin.max():g}; {right} (finite, within "
            f"{LOW_ORIGIN_M:g} m of the cloud's origin)"
        )
    return origin


def _reals(given: Any, wrong: str) -> Float[np.ndarray, " n"]:
    """A JSON text's list of numbers. Raises ValueError `wrong` where it is none."""
    try:
        numbers = np.asarray([*map(real, given)], np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(wrong) from error
    if (np.abs(numbers) > np.finfo(np.float32).max).any():
        raise ValueError(wrong)
    return numbers.astype(np.float32)


def check_about(path: Path, frames: dict[str, Any]) -> None:
    """Raises ValueError where `frames` of a grid.json says of a frame what cannot be."""
    for name, entry in frames.items():
        if not isinstance(entry, dict):
            raise ValueError(
                f"polar frames: {path}: frames[{name!r}] is {as_given(entry)}; it must be an object with any of scene, "
                f"time, speed, heading and tags; {SEE}"
            )
        check_keys(entry, ABOUT_KEYS, where=f"polar frames: {path}: frames[{name!r}]")
        scene = entry.get("scene", "")
        if not isinstance(scene, str | int) or isinstance(scene, bool):
            raise ValueError(
                f"polar frames: {path}: the scene of {name!r} is {as_given(scene)}; it must be a drive's name"
            )
        tags = entry.get("tags", [])
        if not isinstance(tags, list) or not all(isinstance(tag, str) and tag for tag in tags):
            raise ValueError(
                f"polar frames: {path}: the tags of {name!r} are {as_given(tags)}; they must be a list of words, as "
                '["night", "rain"], or be left out'
            )
        for key, unit in (("time", "seconds"), ("speed", "m/s"), ("heading", "radians")):
            value = entry.get(key, 0.0)
            _reals(
                [value],
                f"polar frames: {path}: the {key} of {name!r} is {as_given(value)}; it must be a finite number in "
                f"{unit}, or be left out",
            )
        if abs(entry.get("time", 0.0)) > LATEST_S:
            raise ValueError(
                f"polar frames: {path}: the time of {name!r} is {as_given(entry['time'])}, which is no time in "
                "seconds; divide nanoseconds by 1e9, microseconds by 1e6, milliseconds by 1e3"
            )
        check_motion_of(entry.get("speed", 0.0), entry.get("heading", 0.0), f"polar frames: {path}: frames[{name!r}]")


def check_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Raises ValueError where an array of a frame's .npz has not the type, the shape or the values of its raster.

    `arrays` holds range and intensity, and any others; names that the format does not know are not looked at.
    """
    known = {name: arrays[name] for name in SHAPES if name in arrays}
    for name, array in known.items():
        if array.dtype.kind not in ("iufb" if name in ID_RASTERS else "iuf"):
            raise ValueError(f"polar frames: {path}: {name} holds {array.dtype}; it must hold real numbers; {SEE}")
        if array.ndim != SHAPES[name] or (name == "rgb" and array.shape[-1] != 3):
            right = "(rows, columns, 3), red, green, blue" if name == "rgb" else "(rows, columns)"
            raise ValueError(f"polar frames: {path}: {name} is {array.shape}; it must be {right}")
    range_m, intensity = arrays["range"], arrays["intensity"]
    if range_m.dtype == np.float16:
        # Its steps would be taken for the sensor's.
        raise ValueError(
            f"polar frames: {path}: range holds float16, whose steps are 4 mm at 5 m and 6 cm at 70 m; write float32"
        )
    for name, array in known.items():
        if array.shape[:2] != range_m.shape:
            raise ValueError(
                f"polar frames: {path}: {name} is {array.shape}, range {range_m.shape}; their rows and columns must be "
                "the same"
            )
    if not np.isfinite(range_m).all() or (range_m < 0).any():
        raise ValueError(
            f"polar frames: {path}: range spans {span_in_words(range_m)}; range must be finite metres, 0 where nothing "
            "returned"
        )
    if range_m.max(initial=0) > FAR_M:
        raise ValueError(
            f"polar frames: {path}: range reaches {range_m.max():g}; it must be in metres, and no LiDAR sees beyond "
            f"{FAR_M:g} m (divide millimetres by 1000)"
        )
    if not all_within(intensity, 0, 1):
        raise ValueError(
            f"polar frames: {path}: intensity spans {span_in_words(intensity)}; it must lie in 0..1 "
            "(divide by your sensor's scale; 0 where nothing returned)"
        )
    for name, ids in known.items():
        if name not in ID_RASTERS:
            continue
        if not np.isfinite(ids).all() or (ids != np.round(ids)).any():
            raise ValueError(
                f"polar frames: {path}: {name} spans {span_in_words(ids)}; it must hold whole numbers (ids)"
            )
        if not all_within(ids, *INT32):
            raise ValueError(
                f"polar frames: {path}: {name} spans {span_in_words(ids)}; ids are numbers of 32 bits: count objects "
                "from 1, np.unique(ids, return_inverse=True)[1] + 1"
            )
    if "semantic" in arrays:
        check_classes(arrays["semantic"], f"polar frames: {path}")
    if "incidence" in arrays and not all_within(arrays["incidence"][range_m > 0], 0, STEEPEST_RAD):
        raise ValueError(
            f"polar frames: {path}: incidence spans {span_in_words(arrays['incidence'][range_m > 0])} where the ray "
            "hits; it must be the angle between ray and surface normal in radians, 0 head on to pi/2"
        )
    if "time" in arrays and not np.isfinite(arrays["time"][range_m > 0]).all():
        raise ValueError(
            f"polar frames: {path}: time spans {span_in_words(arrays['time'][range_m > 0])} where the ray hits; it "
            "must be finite seconds, or be left out"
        )
    if "rgb" in arrays:
        rgb = arrays["rgb"]
        if not all_within(rgb, 0, 255) or (rgb.dtype.kind == "f" and 0 < rgb.max(initial=0) <= 1):
            raise ValueError(f"polar frames: {path}: rgb spans {span_in_words(rgb)}; it must lie in 0..255")


def as_given(value: Any) -> str:
    """A value for a message, cut off."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def check_motion_of(speed_mps: float, heading_rad: float, where: str) -> None:
    """Raises ValueError, beginning with `where`, for a speed or a heading that no car has; it names the unit."""
    if not abs(speed_mps) <= FASTEST_MPS:
        raise ValueError(f"{where}: the speed is {speed_mps:g}; it must be in m/s, at most {FASTEST_MPS:g}")
    if not abs(heading_rad) <= TURNS_RAD:
        raise ValueError(f"{where}: the heading is {heading_rad:g}; it must be in radians, not degrees, within -pi..pi")
