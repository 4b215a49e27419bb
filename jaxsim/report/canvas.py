"""A drawing that becomes SVG inside a page and pixels in a file, from the same strokes."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from html import escape
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from jaxsim.report.pictures import Rgb

Points = Float[np.ndarray, "n 2"]
Length = float | int
"""Pixels, whole or not."""

INK = "#222222"
FAINT = "#6b6b6b"
RULE = "#c9c9c9"
BEFORE = "#d55e00"
AFTER = "#0072b2"
"""Vermilion and blue of Okabe and Ito: told apart by any eye, and in grey."""
_PLAIN = {"−": "-", "°": " deg", "·": "*", "–": "-", "±": "+-", "θ": "theta", "≤": "<=", "≥": ">="}


class _Stroke(NamedTuple):
    points: Points
    colour: str
    width: Length


class _Area(NamedTuple):
    points: Points
    colour: str
    opacity: Length


class _Dot(NamedTuple):
    x: Length
    y: Length
    radius: Length
    colour: str
    filled: bool


class _Text(NamedTuple):
    x: Length
    y: Length
    text: str
    anchor: str
    colour: str
    size: Length
    turned: bool


class _Raster(NamedTuple):
    x: Length
    y: Length
    width: Length
    height: Length
    rgb: Rgb


_Mark = _Stroke | _Area | _Dot | _Text | _Raster


@dataclass
class Canvas:
    """Strokes in the order they are drawn; lengths in pixels at 96 a inch, y down."""

    width: int
    height: int
    strokes: list[_Mark] = field(default_factory=list)

    def line(self, points: object, *, colour: str = INK, width: Length = 1.0) -> None:
        self.strokes.append(_Stroke(np.asarray(points, float).reshape(-1, 2), colour, width))

    def area(self, points: object, *, colour: str, opacity: Length = 1.0) -> None:
        self.strokes.append(_Area(np.asarray(points, float).reshape(-1, 2), colour, opacity))

    def dot(self, x: Length, y: Length, *, colour: str = INK, radius: Length = 2.5, hollow: bool = False) -> None:
        self.strokes.append(_Dot(x, y, radius, colour, not hollow))

    def text(
        self,
        x: Length,
        y: Length,
        text: str,
        *,
        anchor: str = "start",
        colour: str = INK,
        size: Length = 12,
        turned: bool = False,
    ) -> None:
        """`y` is the baseline; `anchor` start, middle or end; `turned` reads upwards."""
        self.strokes.append(_Text(x, y, text, anchor, colour, size, turned))

    def raster(self, rgb: Rgb, *, x: Length, y: Length, width: Length, height: Length) -> None:
        """A picture stretched over a rectangle, its cells kept square-edged."""
        self.strokes.append(_Raster(x, y, width, height, rgb))

    def svg(self, label: str) -> str:
        """An <svg> element for a page; `label` says what it shows to who cannot see it."""
        body = "".join(_as_svg(stroke) for stroke in self.strokes)
        size = f'viewBox="0 0 {self.width} {self.height}" style="max-width:{self.width}px"'
        return f'<svg {size} role="img" aria-label="{escape(label)}">{body}</svg>'

    def pixels(self, scale: int = 2) -> Rgb:
        """The drawing on white, `scale` pixels a unit."""
        image = np.full((self.height * scale, self.width * scale, 3), 255, np.uint8)
        for stroke in self.strokes:
            _paint(image, stroke, scale)
        return image


def _path(points: Points) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _as_svg(stroke: _Mark) -> str:
    match stroke:
        case _Stroke(points, colour, width):
            return f'<polyline points="{_path(points)}" fill="none" stroke="{colour}" stroke-width="{width:g}"/>'
        case _Area(points, colour, opacity):
            return f'<polygon points="{_path(points)}" fill="{colour}" fill-opacity="{opacity:g}"/>'
        case _Dot(x, y, radius, colour, filled):
            fill = colour if filled else "#ffffff"
            return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="{fill}" stroke="{colour}"/>'
        case _Text(x, y, text, anchor, colour, size, turned):
            turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
            style = f'text-anchor="{anchor}" fill="{colour}" font-size="{size:g}"{turn}'
            return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{escape(text)}</text>'
        case _Raster(x, y, width, height, rgb):
            return (
                f'<image x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
                f'preserveAspectRatio="none" style="image-rendering:pixelated" href="{data_uri(rgb)}"/>'
            )


def data_uri(rgb: Rgb) -> str:
    """A picture as a PNG inside a page."""
    good, code = cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))
    if not good:
        raise OSError(f"canvas: a picture of {rgb.shape} could not be written as PNG")
    return f"data:image/png;base64,{base64.b64encode(code.tobytes()).decode()}"


def _colour(name: str) -> tuple[int, int, int]:
    return int(name[1:3], 16), int(name[3:5], 16), int(name[5:7], 16)


def _fixed(points: Points, scale: int) -> np.ndarray:
    """Coordinates in sixteenths of a pixel, as OpenCV's drawing takes them."""
    return np.round(points * scale * 16).astype(np.int32).reshape(-1, 1, 2)


def _paint(image: Rgb, stroke: _Mark, scale: int) -> None:
    match stroke:
        case _Stroke(points, colour, width):
            thick = max(1, round(width * scale))
            cv2.polylines(image, [_fixed(points, scale)], False, _colour(colour), thick, cv2.LINE_AA, 4)
        case _Area(points, colour, opacity):
            over = image.copy()
            cv2.fillPoly(over, [_fixed(points, scale)], _colour(colour), cv2.LINE_AA, 4)
            image[:] = cv2.addWeighted(over, opacity, image, 1 - opacity, 0)
        case _Dot(x, y, radius, colour, filled):
            at, wide = (round(x * scale * 16), round(y * scale * 16)), round(radius * scale * 16)
            if not filled:
                cv2.circle(image, at, wide, (255, 255, 255), -1, cv2.LINE_AA, 4)
            thick = -1 if filled else max(1, scale // 2)
            cv2.circle(image, at, wide, _colour(colour), thick, cv2.LINE_AA, 4)
        case _Text():
            _write(image, stroke, scale)
        case _Raster(x, y, width, height, rgb):
            left, top = round(x * scale), round(y * scale)
            size = (round(width * scale), round(height * scale))
            how = cv2.INTER_NEAREST if size[0] >= rgb.shape[1] else cv2.INTER_AREA
            image[top : top + size[1], left : left + size[0]] = cv2.resize(rgb, size, interpolation=how)


def _write(image: Rgb, t: _Text, scale: int) -> None:
    """OpenCV has one plain typeface, without signs beyond ASCII."""
    words = "".join(_PLAIN.get(c, c) for c in t.text).encode("ascii", "replace").decode()
    face, size = cv2.FONT_HERSHEY_SIMPLEX, t.size * scale / 30
    (width, height), below = cv2.getTextSize(words, face, size, 1)
    patch = np.full((height + 2 * below, max(width, 1), 3), 255, np.uint8)
    cv2.putText(patch, words, (0, height + below // 2), face, size, _colour(t.colour), 1, cv2.LINE_AA)
    shift = {"start": 0.0, "middle": width / 2, "end": float(width)}[t.anchor]
    left, top = t.x * scale - shift, t.y * scale - height - below // 2
    if t.turned:
        patch = np.rot90(patch)
        left, top = t.x * scale - height - below // 2, t.y * scale - width + shift
    x, y = max(round(left), 0), max(round(top), 0)
    part = image[y : y + patch.shape[0], x : x + patch.shape[1]]
    np.minimum(part, patch[: part.shape[0], : part.shape[1]], out=part)
