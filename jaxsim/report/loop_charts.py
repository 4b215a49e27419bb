"""Charts of Real2Sim2Real: how detectors end their training, and what the kinds of clouds hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8

from jaxsim.metrics.cloud_checks import REST, CloudCounts, drop_map
from jaxsim.metrics.detection import COLUMNS
from jaxsim.report.canvas import FAINT, INK, RULE, Canvas
from jaxsim.report.pictures import colour_scalar, strip
from jaxsim.simulate.loop import REAL, Loop, read_checkpoints

Rgb = UInt8[np.ndarray, "h w 3"]
Counts = Mapping[str, CloudCounts]
COLOURS = ("#222222", "#d55e00", "#e69f00", "#0072b2", "#56b4e9", "#009e73")
"""Of real, then of the kinds in their order."""
_LEFT, _TOP, _KEY = 60, 40, 130


def epochs_chart(loop: Loop) -> Canvas | None:
    """Moderate 3D AP on real clouds at each of the last checkpoints: a line a kind, the mean over the seeds, and a thin
    line a seed. None where nothing is scored."""
    kinds = (REAL, *loop.config.kinds)
    known = {
        kind: [found for seed in loop.config.seeds if (found := read_checkpoints(loop, kind, REAL, seed))]
        for kind in kinds
    }
    key = f"{COLUMNS[0][0]} {COLUMNS[0][1]} moderate"
    lines = {
        kind: [[c["ap_r40"][key] for c in one] for one in seeds]
        for kind, seeds in known.items()
        if seeds and seeds[0][0]["ap_r40"].get(key) is not None
    }
    if not lines:
        return None
    count = min(len(one) for seeds in lines.values() for one in seeds)
    top = max(10.0, float(np.ceil(max(max(one) for seeds in lines.values() for one in seeds) / 10) * 10))
    width, height = 560, 260
    canvas = Canvas(max(_LEFT + width + 20, _LEFT + _KEY * len(kinds)), _TOP + height + 50)
    _key(canvas, kinds)
    x = _LEFT + width * (np.arange(count) + 0.5) / count
    for part in range(6):
        y = _TOP + height * (1 - part / 5)
        canvas.line([(_LEFT, y), (_LEFT + width, y)], colour=RULE, width=0.5)
        canvas.text(_LEFT - 6, y + 4, f"{top * part / 5:g}", anchor="end", size=11, colour=FAINT)
    for k in range(count):
        words = "last" if k == count - 1 else f"last - {count - 1 - k}"
        canvas.text(float(x[k]), _TOP + height + 16, words, anchor="middle", size=11, colour=FAINT)
    for kind, seeds in lines.items():
        colour = COLOURS[kinds.index(kind)]
        values = np.array([one[-count:] for one in seeds], float)
        for one in values if len(values) > 1 else ():
            canvas.line(np.column_stack([x, _TOP + height * (1 - one / top)]), colour=colour, width=0.5)
        y = _TOP + height * (1 - values.mean(0) / top)
        canvas.line(np.column_stack([x, y]), colour=colour, width=2)
        for a, b in zip(x, y, strict=True):
            canvas.dot(float(a), float(b), colour=colour, radius=3)
    canvas.text(_LEFT + width / 2, _TOP + height + 36, "checkpoint", anchor="middle", size=12, colour=INK)
    canvas.text(14, _TOP + height / 2, "3D AP, moderate, %", anchor="middle", size=12, turned=True)
    return canvas


def intensity_chart(counts: Counts) -> Canvas:
    """Distribution of intensity on cars and elsewhere, a line each kind of cloud."""
    width, height, gap = 380, 230, 70
    canvas = Canvas(2 * (_LEFT + width) + 20, _TOP + height + 50)
    _key(canvas, tuple(counts))
    for side, (name, words) in enumerate((("Car", "on cars"), (REST, "elsewhere"))):
        x0 = _LEFT + side * (width + gap)
        shares = {}
        for kind, own in counts.items():
            histogram = own.histograms.get(name, {}).get("intensity")
            if histogram is not None and histogram.sum():
                # Five steps of 1/100 together.
                shares[kind] = histogram.reshape(20, 5).sum(1) / histogram.sum()
        for part in range(5):
            y = _TOP + height * (1 - part / 4)
            canvas.line([(x0, y), (x0 + width, y)], colour=RULE, width=0.5)
            canvas.text(x0 - 6, y + 4, f"{10 ** (part - 4):g}", anchor="end", size=11, colour=FAINT)
            canvas.text(
                x0 + width * part / 4, _TOP + height + 16, f"{part / 4:g}", anchor="middle", size=11, colour=FAINT
            )
        canvas.text(x0 + width / 2, _TOP + height + 36, f"intensity {words}", anchor="middle", size=12, colour=INK)
        for k, kind in enumerate(counts):
            if kind in shares:
                level = np.clip(np.log10(np.maximum(shares[kind], 1e-9)) / 4 + 1, 0, 1)
                points = [(x0 + (i + 0.5) / 20 * width, _TOP + height * (1 - v)) for i, v in enumerate(level)]
                canvas.line(points, colour=COLOURS[k], width=1.8)
                for x, y in points:
                    canvas.dot(x, y, colour=COLOURS[k], radius=1.5)
    canvas.text(14, _TOP + height / 2, "share of the points", anchor="middle", size=12, turned=True)
    return canvas


def drop_picture(counts: Counts) -> Rgb:
    """Share of the scenes in which a direction returns nothing, a panel each kind of cloud."""
    panels = []
    for kind, own in counts.items():
        empty = drop_map(own)
        panels.append(
            (f"{kind}: share without a return", colour_scalar(empty, np.ones(empty.shape, bool), low=0, high=1))
        )
    return strip(panels, width=900)


def _key(canvas: Canvas, kinds: tuple[str, ...]) -> None:
    for k, kind in enumerate(kinds):
        x = _LEFT + k * _KEY
        canvas.line([(x, 14), (x + 20, 14)], colour=COLOURS[k], width=2)
        canvas.text(x + 25, 18, kind, size=12)
