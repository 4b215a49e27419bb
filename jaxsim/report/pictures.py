"""Pictures that people look at: strips of rasters on the polar grid, frames, and clouds from behind."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from jaxsim.files import file_of, files_in, read_entry, sha256_of, write_image, write_text
from jaxsim.frame import DepthFrame, Painted, Pair, PolarImage

_log = logging.getLogger(__name__)

Rgb = UInt8[np.ndarray, "_ _ 3"]
"""A picture, rows x columns; pictures of one call may differ in size."""
Raster = Float[np.ndarray, "rows columns"]
_Mask = Bool[np.ndarray, "rows columns"]
NO_RETURN = np.array([38, 38, 42], np.uint8)
LABEL, FOUND = (90, 200, 90), (255, 150, 40)
"""Green: labelled. Orange: found."""
LIGHT_INK = (232, 232, 232)

# Cityscapes colours by class id, for the classes that street data sets label.
CLASS_COLOURS = np.full((256, 3), 60, np.uint8)
for _id, _colour in {
    6: (81, 0, 81), 7: (128, 64, 128), 8: (244, 35, 232), 11: (70, 70, 70), 12: (102, 102, 156),
    13: (190, 153, 153), 17: (153, 153, 153), 19: (250, 170, 30), 20: (220, 220, 0), 21: (107, 142, 35),
    22: (152, 251, 152), 23: (70, 130, 180), 24: (220, 20, 60), 25: (255, 0, 0), 26: (0, 0, 142),
    27: (0, 0, 70), 28: (0, 60, 100), 31: (0, 80, 100), 32: (0, 0, 230), 33: (119, 11, 32),
}.items():  # fmt: skip
    CLASS_COLOURS[_id] = _colour


def colour_scalar(
    value: Raster, valid: _Mask, *, low: float | int, high: float | int, gamma: float = 1.0
) -> UInt8[np.ndarray, "rows columns 3"]:
    """A scalar raster in the turbo colour map; cells without a value are dark grey."""
    scaled = np.clip((value - low) / (high - low), 0, 1) ** gamma
    colours = cv2.applyColorMap((scaled * 255).astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1]
    return np.where(valid[..., None], colours, NO_RETURN)


def colour_classes(semantic: Int[np.ndarray, "rows columns"], valid: _Mask) -> UInt8[np.ndarray, "rows columns 3"]:
    """Cityscapes' own colours."""
    return np.where(valid[..., None], CLASS_COLOURS[np.clip(semantic, 0, 255)], NO_RETURN)


def strip(panels: Sequence[tuple[str, UInt8[np.ndarray, "_ _ 3"]]], *, width: int = 1488) -> Rgb:
    """Panels one above the other, each under its title, all scaled to one width by whole cells."""
    rows: list[np.ndarray] = []
    for title, panel in panels:
        scale = width / panel.shape[1]
        # A laser line is drawn taller than it is wide: its angular step is twice the column's.
        height = max(1, round(panel.shape[0] * scale * (1.4 if panel.shape[1] > 4 * panel.shape[0] else 1.0)))
        bar = np.full((26, width, 3), 18, np.uint8)
        cv2.putText(bar, title, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, LIGHT_INK, 1, cv2.LINE_AA)
        interpolation = cv2.INTER_NEAREST if scale >= 1 else cv2.INTER_AREA
        rows += [bar, cv2.resize(np.ascontiguousarray(panel), (width, height), interpolation=interpolation)]
    return np.concatenate(rows)


def beside(pictures: Sequence[Rgb]) -> Rgb:
    """Pictures side by side, filled up below to one height."""
    height = max(len(picture) for picture in pictures)
    return np.concatenate([np.pad(p, ((0, height - len(p)), (0, 4), (0, 0))) for p in pictures], axis=1)


def draw_cloud(points: Float32[np.ndarray, "n 4"], *, size: tuple[int, int] = (520, 740), title: str = "") -> Rgb:
    """A cloud seen from behind and above the sensor, coloured by intensity (x, y, z in metres, 0..1)."""
    height, width = size
    picture = np.full((height, width, 3), 12, np.uint8)
    # A pinhole camera 14 m behind the sensor and 9 m above it, which looks 17 degrees down.
    eye = np.array([-14.0, 0.0, 9.0])
    pitch, focal = np.deg2rad(17), 0.8 * width
    x, y, z = (points[:, :3] - eye).T
    forward = np.cos(pitch) * x - np.sin(pitch) * z
    up = np.sin(pitch) * x + np.cos(pitch) * z
    seen = forward > 1.0
    u = np.round(width / 2 - focal * y[seen] / forward[seen]).astype(int)
    v = np.round(height * 0.46 - focal * up[seen] / forward[seen]).astype(int)
    inside = (u >= 0) & (u < width - 1) & (v >= 0) & (v < height - 1)
    # Far points first, so that near ones cover them.
    order = np.argsort(-forward[seen][inside])
    u, v = u[inside][order], v[inside][order]
    shade = np.clip(points[seen][inside][order, 3] * 1.6, 0, 1) ** 0.7
    # A table of colours, for OpenCV colours no empty list: there may be no point ahead.
    palette = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1]
    colours = palette[(shade * 255).astype(np.uint8)]
    for du, dv in ((0, 0), (1, 0), (0, 1), (1, 1)):
        picture[v + dv, u + du] = colours
    cv2.putText(picture, title, (10, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.55, LIGHT_INK, 1, cv2.LINE_AA)
    return picture


def save_picture(path: Path, picture: Rgb) -> Path:
    """Writes an RGB picture as PNG (or by suffix), whole or not at all."""
    return write_image(path, picture, by="pictures")


def save_pictures(folder: Path, pictures: Iterable[tuple[str, Rgb]], *, by: str) -> None:
    """Writes NAME.png of each (name, picture) in the place of those that an earlier call wrote: a picture of a frame
    that is judged no more would stand beside scores of others.

    Only a file that is still as it was written is removed, by the SHA-256 that pictures.json keeps; other pictures that
    lie there are told. `by` names the command. Raises ValueError where a name can be no file's.
    """
    record = folder / "pictures.json"
    earlier: dict[str, str] = {}
    with suppress(ValueError, OSError):  # none, or a damaged one, by which nothing is removed
        earlier = read_entry(record, "sha256", dict[str, str], by=by)
    for path in files_in(folder, ".png"):
        if not path.is_symlink() and earlier.get(path.name) == sha256_of(path):
            path.unlink()
    record.unlink(missing_ok=True)
    written: dict[str, str] = {}
    for name, picture in pictures:
        path = save_picture(file_of(folder, name, ".png", by=by), picture)
        written[path.name] = sha256_of(path)
        write_text(record, json.dumps({"sha256": written}, indent=1))
    if others := [path.name for path in files_in(folder, ".png") if path.name not in written]:
        _log.warning(
            f"{by}: of the pictures in {folder} {len(others)} were there before (the first: {others[0]}); delete those "
            "of an earlier evaluation"
        )


def intensity_panel(intensity: Raster, valid: _Mask) -> Rgb:
    """Intensity 0..0.6 in colour (brighter saturates); no return is dark grey, a return of 0 is one."""
    return colour_scalar(intensity, valid, low=0.0, high=0.6, gamma=0.7)


def depth_panel(depth_m: Raster, valid: _Mask) -> Rgb:
    """Depth 0-60 m in colour, near ones with finer steps; none is dark grey."""
    return colour_scalar(depth_m, valid, low=0.0, high=60.0, gamma=0.6)


def input_panels(painted: Painted) -> list[tuple[str, Rgb]]:
    """What the camera knows, on the polar window."""
    valid = np.asarray(painted.valid)
    rgb = np.where(valid[..., None], np.asarray(painted.rgb) * 255, 40).astype(np.uint8)
    panels = [
        ("camera, carried to the LiDAR's grid", rgb),
        ("range (0-60 m)", depth_panel(np.asarray(painted.range_m), valid)),
    ]
    semantic = np.asarray(painted.semantic)
    if (semantic > 0).any():
        classes = colour_classes(semantic, valid & ~np.asarray(painted.occluded))
        panels.append(("classes; grey: not seen, or occluded", classes))
    return panels


def pair_picture(pair: Pair, predicted: Raster, *, title: str, spread: Raster | None = None) -> Rgb:
    """Input, prediction (0 is a lost ray), measurement and their difference, one above the other; and, where the
    network gives one, the width of the interval that it holds nine tenths of the measurements to lie in."""
    painted, measured = pair.painted, pair.measured
    seen, returned = np.asarray(painted.valid), np.asarray(measured.valid)
    both = seen & returned
    intensity = np.asarray(measured.intensity)
    error = np.abs(predicted - intensity)
    mean = f"mean {error[both].mean():.3f}" if both.any() else "no cell"
    panels = [
        *input_panels(painted),
        (f"predicted intensity (0-0.6), {title}", intensity_panel(predicted, seen & (predicted > 0))),
        ("measured intensity", intensity_panel(intensity, returned)),
        (f"absolute difference (0-0.3), {mean}", colour_scalar(error, both, low=0.0, high=0.3)),
    ]
    if spread is not None:
        panels.append(("width of the 90 % interval (0-0.6)", colour_scalar(spread, seen, low=0.0, high=0.6)))
    return strip(panels)


def simulated_picture(image: PolarImage, painted: Painted, *, title: str) -> Rgb:
    """Input and prediction of a simulated frame."""
    intensity, valid = np.asarray(image.intensity), np.asarray(image.valid)
    return strip([*input_panels(painted), (f"simulated intensity (0-0.6), {title}", intensity_panel(intensity, valid))])


def depth_picture(frame: DepthFrame, guesses: Sequence[tuple[str, Raster, np.ndarray]]) -> Rgb:
    """Image, the points that are given, each method's dense depth (name, metres, where it has any) and the truth."""
    panels = [
        ("image", np.asarray(frame.rgb)),
        ("given points (0-60 m)", depth_panel(np.asarray(frame.sparse_m), np.asarray(frame.given))),
        *((name, depth_panel(depth_m, valid)) for name, depth_m, valid in guesses),
        ("truth", depth_panel(np.asarray(frame.truth_m), np.asarray(frame.known))),
    ]
    return strip(panels, width=912)
