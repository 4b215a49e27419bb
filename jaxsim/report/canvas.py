"""A drawing as SVG, for a page and for a file.

Drawn here rather than by a plotting library: what a chart's points stand for must answer to a click, its colours follow
the page's, light or dark, and a chart is a few dozen elements. matplotlib would
bring 137 MB and would not be less code.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from jaxsim.files import write_text
from jaxsim.report.pictures import Rgb, save_picture

_Points = Float[np.ndarray, "n 2"]
Length = float | int
"""Pixels, whole or not."""

INK = "#222222"
FAINT = "#6b6b6b"
RULE = "#c9c9c9"
HAIR = "#e6e6e6"
PAPER = "#ffffff"
BEFORE = "#d55e00"
AFTER = "#0072b2"
"""Vermilion and blue of Okabe and Ito: told apart by any eye, and in grey."""
OF_PAGE = {
    INK: "ink", FAINT: "faint", RULE: "rule", HAIR: "hair", PAPER: "paper", BEFORE: "before", AFTER: "after"
}  # fmt: skip
"""Colours that a page sets by these names of its style, light and dark."""
FONT = "system-ui, 'Helvetica Neue', Arial, sans-serif"


@dataclass
class Canvas:
    """Elements in the order they are drawn; lengths in pixels at 96 a inch, y down."""

    width: int
    height: int
    elements: list[Markup] = field(default_factory=list)
    rows: list[tuple[str, ...]] = field(default_factory=list)
    """What it shows as a table, its heads first, for who cannot see it; empty where the page says it already."""

    def _add(self, element: str, *values: object) -> None:
        self.elements.append(Markup(element).format(*values))

    def line(self, points: object, *, colour: str = INK, width: Length = 1.0) -> None:
        self._add('<polyline points="{}" fill="none" stroke="{}" stroke-width="{:g}"/>', _path(points), colour, width)

    def area(self, points: object, *, colour: str, opacity: Length = 1.0) -> None:
        self._add('<polygon points="{}" fill="{}" fill-opacity="{:g}"/>', _path(points), colour, opacity)

    def dot(self, x: Length, y: Length, *, colour: str = INK, radius: Length = 2.5, hollow: bool = False) -> None:
        fill = PAPER if hollow else colour
        self._add('<circle cx="{:.1f}" cy="{:.1f}" r="{:g}" fill="{}" stroke="{}"/>', x, y, radius, fill, colour)

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
        turn = Markup(' transform="rotate(-90 {:.1f} {:.1f})"').format(x, y) if turned else ""
        self._add(
            '<text x="{:.1f}" y="{:.1f}" text-anchor="{}" fill="{}" font-size="{:g}"{}>{}</text>',
            *(x, y, anchor, colour, size, turn, text),
        )

    def raster(self, rgb: Rgb, *, x: Length, y: Length, width: Length, height: Length, name: str = "") -> None:
        """A picture stretched over a rectangle, its cells kept square-edged; `name` is what the viewer finds it by."""
        self._add(
            '<image x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" preserveAspectRatio="none" '
            'style="image-rendering:pixelated"{} href="{}"/>',
            *(x, y, width, height, Markup(' data-map="{}"').format(name) if name else "", data_uri(rgb)),
        )

    def target(
        self, chart: str, index: int, words: str, *, x: Length, y: Length, width: Length, height: Length
    ) -> None:
        """A rectangle that answers to a click and to the keyboard, which lights the rays (viewer.js) of so numbered a
        part of a `chart`: `row`, or the name of a curve. `words` say what it stands for."""
        self._add(
            '<rect class="target" fill="none" data-chart="{}" data-index="{}" aria-label="{}" '
            'x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>',
            *(chart, index, words, x, y, width, height),
        )

    def svg(self, label: str) -> Markup:
        """An <svg> element for a page, in the page's colours; `label` says what it shows to who cannot see it."""
        body = "".join(self.elements)
        for colour, name in OF_PAGE.items():
            body = body.replace(f'"{colour}"', f'"var(--{name})"')
        # A group keeps its parts, which answer to the keyboard; an image would hide them.
        role = "group" if 'class="target"' in body else "img"
        size = Markup('viewBox="0 0 {0} {1}" style="max-width:{0}px"').format(self.width, self.height)
        return Markup('<svg {} role="{}" aria-label="{}">{}</svg>').format(size, role, label, Markup(body))

    def file(self, label: str) -> str:
        """The text of an SVG file, on white."""
        head = Markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0} {1}" width="{0}" height="{1}" font-family="{2}">'
            '<title>{3}</title><rect width="{0}" height="{1}" fill="{4}"/>'
        ).format(self.width, self.height, FONT, label, PAPER)
        return f"{head}{''.join(self.elements)}</svg>\n"


def save_figure(folder: Path, name: str, drawn: Canvas | Rgb, *, words: str) -> Path:
    """Writes a drawing as NAME.svg, pixels as NAME.png, whole or not at all; `words` say what it shows."""
    if not isinstance(drawn, Canvas):
        return save_picture(folder / f"{name}.png", drawn)
    return write_text(folder / f"{name}.svg", drawn.file(words))


def _path(points: object) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in np.asarray(points, float).reshape(-1, 2))


def data_uri(rgb: Rgb) -> str:
    """A picture as a PNG inside a page."""
    good, code = cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))
    if not good:
        raise OSError(f"canvas: a picture of {rgb.shape} could not be written as PNG")
    return f"data:image/png;base64,{base64.b64encode(code.tobytes()).decode()}"
