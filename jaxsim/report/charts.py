"""Charts of a discovery: residual maps on the polar grid, curves along a covariate, values with intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.discover.verdict import Interval
from jaxsim.frame import PolarGrid
from jaxsim.report.canvas import AFTER, FAINT, HAIR, INK, RULE, Canvas, Length, Rgb
from jaxsim.report.page import number

Map = Float[np.ndarray, "r c"]
_Line = Float[np.ndarray, " k"]

ANCHORS = np.array(
    [(5, 48, 97), (67, 147, 195), (209, 229, 240), (250, 250, 250), (253, 219, 199), (214, 96, 77), (103, 0, 31)], float
)
"""Blue - white - red, of even steps in lightness: ColorBrewer's RdBu, safe for colour-blind eyes."""
NO_VALUE = (176, 176, 176)
MAP_WIDTH = 400
MOST_LINES = 200
"""Points of a chart that are told as a table, too."""
SHARE_SHOWN = 98
"""Percentile of the residuals' size that the colours reach, if their root mean square does not reach farther."""


def diverging(value: Map, limit: float) -> Rgb:
    """Values in -limit..limit in blue, white, red; grey where there is none."""
    share = np.clip(np.nan_to_num(value) / limit, -1, 1) * 0.5 + 0.5
    anchors = np.linspace(0, 1, len(ANCHORS))
    rgb = np.stack([np.interp(share, anchors, ANCHORS[:, k]) for k in range(3)], axis=-1)
    return np.where(np.isfinite(value)[..., None], np.round(rgb), NO_VALUE).astype(np.uint8)


def ticks(low: Length, high: Length, count: int = 5, *, whole: bool = False) -> list[float]:
    """Round numbers within low..high, about `count` of them; `whole` ones for rows and classes."""
    if not high > low:
        return [float(low)]
    raw = (high - low) / count
    base = 10 ** math.floor(math.log10(raw))
    # A hair of slack, for a range of exactly so many steps must not lose one to rounding.
    step = base * next(m for m in (1, 2, 2.5, 5, 10) if m * base >= raw * 0.999 and not (whole and m == 2.5))
    step = max(step, 1) if whole else step
    first = math.ceil(low / step - 1e-9)
    return [round(k * step, 12) + 0.0 for k in range(first, math.floor(high / step + 1e-9) + 1)]


def label(value: Length) -> str:
    """A number as it stands beside an axis: six digits at most, with a true minus sign."""
    return f"{value:.6g}".replace("-", "−")


def draw_maps(maps: Sequence[tuple[str, Map]], grid: PolarGrid, *, unit: str, name: str = "") -> Canvas | None:
    """Titled maps beside each other, one colour scale with its bar; None where nothing was compared. The viewer finds
    them by `name`."""
    limit = colour_limit([values for _, values in maps])
    if limit is None:
        return None
    rows, columns = maps[0][1].shape
    height = int(np.clip(MAP_WIDTH * rows / columns * 1.8, 120, 240))
    margin, top = 52, 24
    canvas = Canvas(margin + len(maps) * (MAP_WIDTH + 22) + 88, height + 66)
    for k, (title, values) in enumerate(maps):
        x = margin + k * (MAP_WIDTH + 22)
        canvas.text(x, top - 8, title, size=13)
        found_by = f"{name} {title}" if name else ""
        canvas.raster(diverging(values, limit), x=x, y=top, width=MAP_WIDTH, height=height, name=found_by)
        _frame(canvas, x=x, y=top, width=MAP_WIDTH, height=height)
        for share, text in azimuth_ticks(grid):
            across = x + share * MAP_WIDTH
            canvas.line([(across, top + height), (across, top + height + 4)], colour=FAINT)
            # Labels at the rim stay inside it: the next map's begin there.
            anchor = "start" if share < 0.03 else "end" if share > 0.97 else "middle"
            canvas.text(across, top + height + 17, text, anchor=anchor, size=11, colour=FAINT)
        canvas.text(x + MAP_WIDTH / 2, top + height + 34, "azimuth, °", anchor="middle", size=11, colour=FAINT)
        for row in ticks(0, rows - 1, 4, whole=True):
            y = top + (row + 0.5) / rows * height
            canvas.line([(x - 4, y), (x, y)], colour=FAINT)
            if k == 0:
                canvas.text(x - 7, y + 4, label(row), anchor="end", size=11, colour=FAINT)
    canvas.text(14, top + height / 2, "row", anchor="middle", size=11, colour=FAINT, turned=True)
    _colour_bar(canvas, limit, unit, x=margin + len(maps) * (MAP_WIDTH + 22), top=top, height=height)
    return canvas


def root_mean_square(values: Float[np.ndarray, "..."]) -> float:
    """The root mean square of the values that are finite, in their unit; NaN where none is."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def colour_limit(residuals: Sequence[Float[np.ndarray, "..."]]) -> float | None:
    """The residual at which the colours of maps or rays end, whatever their shapes; None where none has a value."""
    known = np.abs(np.concatenate([values[np.isfinite(values)] for values in residuals]))
    if not known.size:
        return None
    # Few strong cells on a quiet map (lost rays) would saturate a scale that the many quiet ones set.
    return float(max(np.percentile(known, SHARE_SHOWN), np.sqrt(np.mean(known**2)))) or 1.0


def azimuth_ticks(grid: PolarGrid) -> list[tuple[float, str]]:
    """Round azimuths: the share (0..1) of the columns at which each lies, and its degrees as text."""
    azimuth = np.rad2deg(np.unwrap(np.asarray(grid.azimuth_rad, float)))
    columns = np.arange(len(azimuth))
    order = np.argsort(azimuth)
    wide = azimuth.max() - azimuth.min()
    values = [90.0 * k for k in range(-8, 9)] if wide > 200 else ticks(azimuth.min(), azimuth.max(), 5)
    inside = [v for v in values if azimuth.min() - 0.5 <= v <= azimuth.max() + 0.5]
    shares = [(float(np.interp(v, azimuth[order], columns[order])) + 0.5) / len(azimuth) for v in inside]
    return [(share, label(v)) for share, v in zip(shares, inside, strict=True)]


def _colour_bar(canvas: Canvas, limit: float, unit: str, *, x: Length, top: Length, height: Length) -> None:
    scale = np.linspace(limit, -limit, 128)[:, None]
    canvas.raster(diverging(scale, limit), x=x, y=top, width=14, height=height)
    _frame(canvas, x=x, y=top, width=14, height=height)
    for value in ticks(-limit, limit, 4):
        y = top + (limit - value) / (2 * limit) * height
        canvas.line([(x + 14, y), (x + 18, y)], colour=FAINT)
        canvas.text(x + 22, y + 4, label(value), size=11, colour=FAINT)
    canvas.text(x + 74, top + height / 2, unit, anchor="middle", size=11, colour=FAINT, turned=True)


def _frame(canvas: Canvas, *, x: Length, y: Length, width: Length, height: Length) -> None:
    right, bottom = x + width, y + height
    corners = [(x, y), (right, y), (right, bottom), (x, bottom), (x, y)]
    canvas.line(corners, colour=FAINT, width=0.75)


Coordinate = Callable[[Any], Any]
"""From values to pixels."""


def scaled(values: tuple[float, float], pixels: tuple[Length, Length]) -> Coordinate:
    """Where values lie of which the first and the last lie at these pixels."""
    first, last = values
    begin, end = pixels
    return lambda value: begin + (value - first) / (last - first) * (end - begin)


def x_axis(
    canvas: Canvas,
    across: Coordinate,
    marks: Sequence[float],
    *,
    left: int,
    right: int,
    bottom: int,
    words: str,
    text_of: Callable[[float], str] = label,
) -> None:
    """A level axis with its marks, each with its text (`text_of`), and, below them, its words."""
    canvas.line([(left, bottom), (right, bottom)], colour=RULE)
    for value in marks:
        canvas.line([(across(value), bottom), (across(value), bottom + 4)], colour=FAINT)
        canvas.text(across(value), bottom + 17, text_of(value), anchor="middle", size=11, colour=FAINT)
    canvas.text((left + right) / 2, bottom + 36, words, anchor="middle", size=12)


def level_lines(canvas: Canvas, up: Coordinate, marks: Sequence[float], *, left: int, right: Length) -> None:
    """The marks of an upright axis: a hair line across the chart at each, its number to the left."""
    for value in marks:
        canvas.line([(left, up(value)), (right, up(value))], colour=HAIR)
        canvas.text(left - 8, up(value) + 4, label(value), anchor="end", size=11, colour=FAINT)


def _axes(
    canvas: Canvas, x: tuple[float, float], y: tuple[float, float], *, x_label: str, y_label: str, whole: bool
) -> tuple[Coordinate, Coordinate]:
    """Draws the axes of a chart that fills the canvas; returns where values lie on it."""
    left, right = 72, canvas.width - 14
    top, bottom = 14, canvas.height - 44
    x = x if x[1] > x[0] else (x[0] - 1, x[1] + 1)
    y = y if y[1] > y[0] else (y[0] - 1, y[1] + 1)
    across, up = scaled(x, (left, right)), scaled(y, (bottom, top))
    level_lines(canvas, up, ticks(*y, 5), left=left, right=right)
    if y[0] < 0 < y[1]:
        canvas.line([(left, up(0)), (right, up(0))], colour=FAINT)
    x_axis(canvas, across, ticks(*x, 7, whole=whole), left=left, right=right, bottom=bottom, words=x_label)
    canvas.text(16, (top + bottom) / 2, y_label, anchor="middle", size=12, turned=True)
    return across, up


def _runs(good: np.ndarray) -> list[np.ndarray]:
    """Indices of the stretches without gaps."""
    index = np.flatnonzero(good)
    return [run for run in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(run)]


def _limits(*lines: np.ndarray) -> tuple[float, float]:
    values = np.concatenate([line[np.isfinite(line)] for line in (*lines, np.zeros(1))])
    low, high = float(values.min()), float(values.max())
    room = 0.06 * (high - low) or 1.0
    return low - room, high + room


def curve_chart(
    x: _Line,
    lines: Sequence[tuple[str, _Line, str]],
    band: _Line,
    *,
    x_label: str,
    y_label: str,
    joined: bool = True,
    whole: bool = False,
    name: str = "",
) -> Canvas | None:
    """(name, values, colour) along x, the band about the first; None where no value is finite.

    Categories are not `joined`: points with bars. Rows and classes are `whole` numbers. Of a chart with a `name`, each
    point answers to a click.
    """
    first = lines[0][1]
    if not any(np.isfinite(values).any() for _, values, _ in lines):
        return None
    canvas = Canvas(720, 290)
    band = np.where(np.isfinite(band), band, 0)
    edge = 0.5 if not joined else 0.0
    across, up = _axes(
        canvas,
        (float(x.min()) - edge, float(x.max()) + edge),
        _limits(first - band, first + band, *(values for _, values, _ in lines)),
        x_label=x_label,
        y_label=y_label,
        whole=whole,
    )
    for run in _runs(np.isfinite(first)) if joined else []:
        rim = [(across(x[k]), up(first[k] + band[k])) for k in run]
        rim += [(across(x[k]), up(first[k] - band[k])) for k in run[::-1]]
        canvas.area(rim, colour=lines[0][2], opacity=0.18)
    for order, (_, values, colour) in enumerate(lines):
        for run in _runs(np.isfinite(values)):
            if joined and len(run) > 1:
                canvas.line([(across(x[k]), up(values[k])) for k in run], colour=colour, width=2)
            for k in run:
                if not joined and order == 0:
                    bar = [(across(x[k]), up(first[k] + sign * band[k])) for sign in (-1, 1)]
                    canvas.line(bar, colour=colour)
                if not joined or len(x) <= 40:
                    canvas.dot(across(x[k]), up(values[k]), colour=colour, radius=2.6, hollow=order == 0)
    heads = [name for name, _, _ in lines]
    if len(x) <= MOST_LINES:
        canvas.rows = [(x_label, *heads, "half of the 90 % band")]
        canvas.rows += [
            (label(float(at)), *(number(float(values[k])) for _, values, _ in lines), number(float(band[k])))
            for k, at in enumerate(x)
        ]
    if name:
        words = [at_words(x_label, row[0]) for row in canvas.rows[1:]] or [x_label]
        _targets(canvas, x, across, name=name, words=words)
    return canvas


def at_words(x_label: str, at: str) -> str:
    """Words for a point of an axis: what an axis explains in brackets would come between its name and the number."""
    return f"{x_label.partition(' (')[0]} {at}"


def _targets(canvas: Canvas, x: _Line, across: Coordinate, *, name: str, words: Sequence[str]) -> None:
    """Strips about the points of a chart, from halfway to the point before to halfway to the next."""
    between = (x[1:] + x[:-1]) / 2
    ends = [float(x[0]), *between.tolist(), float(x[-1])]
    for k in range(len(x)):
        left, right = sorted((across(ends[k]), across(ends[k + 1])))
        # The first and the last strip, and those of narrow charts, stay wide enough to hit.
        left, right = left - (k == 0) * 6, right + (k == len(x) - 1) * 6
        label = words[k] if k < len(words) else words[0]
        canvas.target(name, k, label, x=left, y=14, width=right - left, height=canvas.height - 58)


def interval_chart(
    values: Sequence[Interval], *, neutral: float, x_label: str, y_label: str, name: str = ""
) -> Canvas | None:
    """One value with its interval at each place 0, 1, ...; the neutral value as a line. Of a chart with a `name`, each
    place answers to a click."""
    array = np.array([(v.value, v.low, v.high) for v in values], float).reshape(-1, 3)
    if not np.isfinite(array[:, 0]).any():
        return None
    canvas = Canvas(720, 250)
    finite = np.where(np.isfinite(array), array, array[:, :1])
    spread = _limits(finite.ravel() - neutral)
    across, up = _axes(
        canvas,
        (-0.7, len(array) - 0.3),
        (spread[0] + neutral, spread[1] + neutral),
        x_label=x_label,
        y_label=y_label,
        whole=True,
    )
    canvas.line([(across(-0.7), up(neutral)), (across(len(array) - 0.3), up(neutral))], colour=INK, width=0.75)
    for k, (value, low, high) in enumerate(finite):
        if math.isfinite(value):
            canvas.line([(across(k), up(low)), (across(k), up(high))], colour=AFTER, width=1.4)
            canvas.dot(across(k), up(value), colour=AFTER, radius=2.2)
    canvas.rows = [(x_label, y_label, "90 % from", "to")]
    canvas.rows += [(str(k), *(number(float(one)) for one in row)) for k, row in enumerate(array)]
    if name:
        words = [at_words(x_label, str(k)) for k in range(len(array))]
        _targets(canvas, np.arange(len(array), dtype=float), across, name=name, words=words)
    return canvas
