"""What kinds of clouds hold, short of a detector: tables, charts and pictures of each class, before any detector is
trained; and how detectors end their training.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from math import ceil, floor, log10
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.files import read_entry
from jaxsim.metrics.cloud_checks import (
    DISTANCES_M,
    EDGES,
    REST,
    CloudCounts,
    band_name,
    classes_in,
    compare_clouds,
    drop_map,
)
from jaxsim.report.canvas import Canvas, save_figure
from jaxsim.report.charts import level_lines, scaled, x_axis
from jaxsim.report.pictures import Rgb, colour_scalar, strip
from jaxsim.report.results import markdown_table, write_results
from jaxsim.studies.real2sim2real import REAL

Counts = Mapping[str, CloudCounts]
"""What the clouds of each kind hold."""
Shares = Float[np.ndarray, " n"]
KIND_COLOURS = ("#222222", "#d55e00", "#e69f00", "#0072b2", "#56b4e9", "#009e73")
"""Colours of real, then of the kinds in their order."""
_LEFT = 60
_TOP = 40
_WIDTH = 380
_HEIGHT = 230
_GAP = 70
_KEY = 130
_DECADES = 4
"""Decades of a logarithmic panel, from 1 down."""
_STEP = {"range": 10.0, "height": 1.0, "intensity": 0.25}
"""Step between two marks of an axis."""
Table = tuple[tuple[str, ...], list[list[str]]]
BANDS = {band_name(band): f"on one, {band[0]:g}-{band[1]:g} m" for band in DISTANCES_M}
OF_CLASS = {
    "objects": "objects",
    **BANDS,
    "range_m": "range, off by (m)",
    "height_m": "height (m)",
    "intensity": "intensity",
}
OF_SCENE = {
    "points": "points a scene",
    "rest_intensity": "intensity elsewhere, off by",
    "empty": "share of directions empty",
    "empty_off": "off by",
}
WORDS = (
    "Clouds of training scenes, in the detector's range: median points on an object at its distance, and how far the "
    "distributions of its points' range, height and intensity are from the real clouds' (Wasserstein-1)."
)


class _Panel(NamedTuple):
    """One histogram of all kinds of clouds."""

    kind: str
    quantity: str
    together: int
    """Bins of EDGES that make one of the chart."""
    words: str
    logarithmic: bool = False


def _panels(kind: str) -> tuple[_Panel, _Panel, _Panel]:
    on = "elsewhere" if kind == REST else f"on {kind.lower()}s"
    return (
        _Panel(kind, "range", 2, f"range {on}, m"),
        _Panel(kind, "height", 2, f"height above the LiDAR {on}, m"),
        _Panel(kind, "intensity", 5, f"intensity {on}", True),
    )


def class_chart(counts: Counts, kind: str) -> Canvas:
    """Distributions of range, height and intensity of the points on a class of object, or of REST."""
    return _histograms(counts, _panels(kind))


def intensity_chart(counts: Counts, kind: str) -> Canvas:
    """Distribution of intensity on a class of object and elsewhere, a line each kind of cloud."""
    return _histograms(counts, (_panels(kind)[2], _panels(REST)[2]))


def drop_picture(counts: Counts) -> Rgb:
    """Share of the scenes in which a direction returns nothing, a panel each kind of cloud; the key below."""
    maps = {f"{kind}: share without a return": drop_map(of_kind) for kind, of_kind in counts.items()}
    columns = next(iter(maps.values())).shape[1]
    key = np.broadcast_to(np.linspace(0, 1, columns), (max(columns // 60, 1), columns))
    maps["key: 0, every scene returns (left), to 1, none does (right)"] = key
    panels = [
        (title, colour_scalar(part, np.ones(part.shape, bool), low=0.0, high=1.0)) for title, part in maps.items()
    ]
    return strip(panels, width=900)


def epochs_chart(curves: Mapping[str, Sequence[Sequence[float]]]) -> Canvas | None:
    """Moderate 3D AP (percent) on real clouds at each of the last checkpoints: a line a kind, the mean over the seeds,
    and a thin line a seed. `curves` are a kind's, one a seed; None where no kind has any."""
    known = [one for seeds in curves.values() for one in seeds]
    if not known:
        return None
    # Seeds may have kept different numbers of checkpoints; what they share is the end of the training.
    count = min(map(len, known))
    top = max(10.0, float(np.ceil(max(map(max, known)) / 10) * 10))
    width, height = 560, 260
    canvas = Canvas(max(_LEFT + width + 20, _LEFT + _KEY * len(curves)), _TOP + height + 50)
    _colour_key(canvas, tuple(curves))
    right, bottom = _LEFT + width, _TOP + height
    middle = lambda k: _LEFT + width * (k + 0.5) / count  # noqa: E731
    up = lambda ap: bottom - height * ap / top  # noqa: E731
    level_lines(canvas, up, [top * part / 5 for part in range(6)], left=_LEFT, right=right)
    words = lambda k: "last" if k == count - 1 else f"last - {count - 1 - k}"  # noqa: E731
    x_axis(canvas, middle, range(count), left=_LEFT, right=right, bottom=bottom, words="checkpoint", text_of=words)
    x = middle(np.arange(count))
    for k, seeds in enumerate(curves.values()):
        if not seeds:
            continue
        colour = KIND_COLOURS[k]
        values = np.array([one[-count:] for one in seeds], float)
        for one in values if len(values) > 1 else ():
            canvas.line(np.column_stack([x, up(one)]), colour=colour, width=0.5)
        y = up(values.mean(0))
        canvas.line(np.column_stack([x, y]), colour=colour, width=2)
        for a, b in zip(x, y, strict=True):
            canvas.dot(float(a), float(b), colour=colour, radius=3)
    canvas.text(14, _TOP + height / 2, "3D AP, moderate, %", anchor="middle", size=12, turned=True)
    return canvas


def _colour_key(canvas: Canvas, kinds: Sequence[str]) -> None:
    """A line and a name for each kind of cloud, along the top."""
    for k, kind in enumerate(kinds):
        x = _LEFT + k * _KEY
        canvas.line([(x, 14), (x + 20, 14)], colour=KIND_COLOURS[k], width=2)
        canvas.text(x + 25, 18, kind, size=12)


def _shares(counts: Counts, panel: _Panel) -> dict[str, Shares]:
    """Each kind of cloud's share of points in each bin of the chart, where it has any."""
    shares = {}
    for name, of_kind in counts.items():
        histogram = of_kind.histograms.get(panel.kind, {}).get(panel.quantity)
        if histogram is not None and histogram.sum():
            shares[name] = histogram.reshape(-1, panel.together).sum(1) / histogram.sum()
    return shares


def _histograms(counts: Counts, panels: Sequence[_Panel]) -> Canvas:
    width = max(len(panels) * (_WIDTH + _GAP) - _GAP + _LEFT + 20, _LEFT + _KEY * len(counts))
    canvas = Canvas(width, _TOP + _HEIGHT + 50)
    _colour_key(canvas, tuple(counts))
    for k, panel in enumerate(panels):
        _draw(canvas, counts, panel, left=_LEFT + k * (_WIDTH + _GAP))
    canvas.text(14, _TOP + _HEIGHT / 2, "share of the points", anchor="middle", size=12, turned=True)
    return canvas


def _draw(canvas: Canvas, counts: Counts, panel: _Panel, *, left: int) -> None:
    shares = _shares(counts, panel)
    edges, step = EDGES[panel.quantity][:: panel.together], _STEP[panel.quantity]
    middles = (edges[1:] + edges[:-1]) / 2
    first, last = _span(shares, edges, step)
    top = 1.0 if panel.logarithmic else _round_up(max((float(share.max()) for share in shares.values()), default=0.0))

    across = scaled((first, last), (left, left + _WIDTH))

    def up(share: Any) -> Any:
        # No share is none: below the last decade the line lies on the axis.
        level = np.log10(np.maximum(share, 1e-9)) / _DECADES + 1 if panel.logarithmic else share / top
        return _TOP + _HEIGHT * (1 - np.clip(level, 0, 1))

    marks = [10.0 ** (part - _DECADES) if panel.logarithmic else top * part / 4 for part in range(5)]
    right, bottom = left + _WIDTH, _TOP + _HEIGHT
    level_lines(canvas, up, marks, left=left, right=right)
    steps = np.arange(first, last + 1e-9, step).tolist()
    x_axis(canvas, across, steps, left=left, right=right, bottom=bottom, words=panel.words)
    for k, name in enumerate(counts):
        if name in shares:
            seen = (middles > first) & (middles < last)
            points = np.column_stack([across(middles[seen]), up(shares[name][seen])])
            canvas.line(points, colour=KIND_COLOURS[k], width=1.8)
            for x, y in points.tolist():
                canvas.dot(x, y, colour=KIND_COLOURS[k], radius=1.5)


def _span(shares: Mapping[str, Shares], edges: Float[np.ndarray, " m"], step: float) -> tuple[float, float]:
    """The part of the axis that holds points, in whole steps; all of it where none does."""
    filled = sum(shares.values(), np.zeros(len(edges) - 1)) > 0
    low, high = (edges[:-1][filled].min(), edges[1:][filled].max()) if filled.any() else (edges[0], edges[-1])
    return floor(low / step + 1e-6) * step, ceil(high / step - 1e-6) * step


def _round_up(value: float) -> float:
    """Rounds up to 1, 2, 4 or 8 times a power of ten."""
    if value <= 0:
        return 1.0
    power = 10.0 ** (ceil(log10(value)) - 1)
    return next(step * power for step in (1, 2, 4, 8, 10) if step * power >= value * (1 - 1e-9))


def cloud_measures(counts: Counts, kind: str) -> dict[str, dict[str, float]]:
    """Measures of all kinds of clouds for one class; `counts` holds `real` and the others."""
    return compare_clouds(counts[REAL], {name: of_kind for name, of_kind in counts.items() if name != REAL}, kind)


def check_tables(counts: Counts, first: str) -> dict[str, Table]:
    """Title -> heads and rows: whole scenes, then each class that is there, `first` first."""
    classes = classes_in(counts, first)
    tables = {"Whole scenes": _table(cloud_measures(counts, first), OF_SCENE)}
    return tables | {kind: _table(cloud_measures(counts, kind), OF_CLASS) for kind in classes}


def _table(rows: Mapping[str, Mapping[str, float]], measures: Mapping[str, str]) -> Table:
    """Bands of distance in which no cloud has an object are left out."""
    shown = {
        name: words
        for name, words in measures.items()
        if name not in BANDS or any(not math.isnan(row[name]) for row in rows.values())
    }
    return ("clouds", *shown.values()), [[kind, *(_cell(row[name]) for name in shown)] for kind, row in rows.items()]


def _cell(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.0f}" if value >= 1000 else f"{value:.4g}"


def check_text(counts: Counts, first: str) -> str:
    """Markdown of all tables."""
    tables = (f"{title}:\n\n{markdown_table(*table)}" for title, table in check_tables(counts, first).items())
    return "\n\n".join([WORDS, *tables])


def checked_kinds(out: Path) -> tuple[str, ...]:
    """Kinds of clouds that OUT/clouds.json compares; none where there is no such file."""
    path = out / "clouds.json"
    return tuple(read_entry(path, "clouds", list[str], by="real2sim2real")) if path.is_file() else ()


def write_checks(out: Path, counts: Counts, first: str, *, pictures: Mapping[str, Rgb]) -> dict[str, Canvas | Rgb]:
    """Writes OUT/clouds.md, OUT/clouds.json, and OUT/pictures, of which it gives all: those given; drop maps; intensity
    on `first` and elsewhere; range, height and intensity on each class."""
    on = {f"on_{kind.lower()}": kind for kind in classes_in(counts, first)} | {"elsewhere": REST}
    drawn: dict[str, Canvas | Rgb] = {
        **pictures,
        "drops": drop_picture(counts),
        "intensity": intensity_chart(counts, first),
        **{name: class_chart(counts, kind) for name, kind in on.items()},
    }
    for name, picture in drawn.items():
        save_figure(out / "pictures", name, picture, words=name.replace("_", " "))
    classes = {kind: cloud_measures(counts, kind) for kind in classes_in(counts, first)}
    content = {"clouds": list(counts), "classes": classes}
    write_results(out, "clouds", content, text=check_text(counts, first), indent=1)
    return drawn
