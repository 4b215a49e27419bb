"""KITTI's scores of a detector: tables as the papers print them, JSON, and precision over recall."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxsim.metrics.detection import DIFFICULTIES, OVERLAP_SETS, PRINTED_COLUMNS, Curve
from jaxsim.metrics.detection.matching import SLOTS
from jaxsim.report.canvas import AFTER, BEFORE, FAINT, INK, RULE, Canvas, Length, save_figure
from jaxsim.report.results import list_facts, markdown_table, write_results

_NAMES = {"3d": "3D", "bev": "BEV", "bbox": "2D", "aos": "AOS"}
_COLOURS = dict(zip(DIFFICULTIES, (AFTER, INK, BEFORE), strict=True))
_LEFT, _TOP = 56, 46
_PANEL, _GAP = 190, 34
"""Margins of the picture, side of a panel and space between panels, pixels."""
Means = Mapping[tuple[str, str, str], tuple[float, float]]
"""Mean and standard deviation of AP R40 by metric, overlap set and difficulty."""


def detection_table(curves: Sequence[Curve], *, average: str = "ap_r40") -> str:
    """A Markdown table a class: one row a difficulty, the paper's columns; `average` is ap_r40 or ap_r11. Where labels
    are too few for an R40 of 100, a line below says what is the most."""
    blocks = []
    for kind in dict.fromkeys(curve.kind for curve in curves):
        known = {(c.difficulty, c.metric, c.overlap_set): c for c in curves if c.kind == kind}
        columns = [column for column in PRINTED_COLUMNS if any((name, *column) in known for name in DIFFICULTIES)]
        some = next(iter(DIFFICULTIES))
        head = [f"{_NAMES[metric]}@{known[some, metric, which].min_overlap:g}" for metric, which in columns]
        rows = []
        for name in DIFFICULTIES:
            row = [known[name, *column] for column in columns]
            counts = f"{row[0].truths}", f"{row[0].detections}"
            values = [getattr(curve, average) for curve in row]
            rows.append([name, *counts, *("-" if math.isnan(value) else f"{value:.2f}" for value in values)])
        blocks.append(markdown_table([f"{kind}, AP {average[3:].upper()}", "labels", "detections", *head], rows))
        labels = {name: known[name, *columns[0]].truths for name in DIFFICULTIES}
        few = [f"{name} {(n - 1) / 0.4:.1f}" for name, n in labels.items() if 0 < n < SLOTS]
        if few and average == "ap_r40":
            most = f"with fewer than {SLOTS}, R40 is at most {', '.join(few)}."
            blocks.append(f"KITTI's rules fill a slot of recall a label: {most}")
    return "\n\n".join(blocks)


def precision_recall_picture(curves: Sequence[Curve], overlap_set: str) -> Canvas:
    """Precision over recall: a row of panels a class, a panel a metric, a line a difficulty."""
    kinds = list(dict.fromkeys(curve.kind for curve in curves))
    metrics = [m for m in ("bbox", "aos", "bev", "3d") if any(curve.metric == m for curve in curves)]
    canvas = Canvas(_LEFT + len(metrics) * (_PANEL + _GAP), _TOP + len(kinds) * (_PANEL + _GAP + 14) + 14)
    x = _LEFT
    for name, colour in _COLOURS.items():
        canvas.line([(x, 14), (x + 22, 14)], colour=colour, width=2)
        canvas.text(x + 28, 18, name, size=12)
        x += 110
    for i, kind in enumerate(kinds):
        for j, metric in enumerate(metrics):
            x, y = _LEFT + j * (_PANEL + _GAP), _TOP + i * (_PANEL + _GAP + 14)
            some = [c for c in curves if (c.kind, c.metric, c.overlap_set) == (kind, metric, overlap_set)]
            canvas.text(x, y - 5, f"{kind} {_NAMES[metric]}@{some[0].min_overlap:g}", size=12)
            _panel(canvas, some, x=x, y=y, labelled=j == 0)
    canvas.text(_LEFT + len(metrics) * (_PANEL + _GAP) / 2, canvas.height - 6, "recall", anchor="middle", size=12)
    canvas.text(14, canvas.height / 2, "precision (AOS: similarity)", anchor="middle", size=12, turned=True)
    return canvas


def _panel(canvas: Canvas, curves: Sequence[Curve], *, x: Length, y: Length, labelled: bool) -> None:
    """Draws one square of precision over recall, its upper left corner at (x, y)."""
    for k in range(6):
        across, up = x + k / 5 * _PANEL, y + (1 - k / 5) * _PANEL
        canvas.line([(x, up), (x + _PANEL, up)], colour=RULE, width=0.5)
        canvas.line([(across, y), (across, y + _PANEL)], colour=RULE, width=0.5)
        if k % 5 == 0:
            canvas.text(across, y + _PANEL + 15, f"{k // 5}", anchor="middle", size=11, colour=FAINT)
            if labelled:
                canvas.text(x - 6, up + 4, f"{k // 5}", anchor="end", size=11, colour=FAINT)
    for curve in curves:
        reached = len(curve.threshold)
        points = [(x + r / 40 * _PANEL, y + (1 - curve.precision[r]) * _PANEL) for r in range(reached)]
        if points:
            canvas.line([*points, (points[-1][0], y + _PANEL)], colour=_COLOURS[curve.difficulty], width=1.5)


def mean_table(means: Means) -> str:
    """A Markdown table of AP R40 over checkpoints, mean (standard deviation), of one class."""
    rows = []
    for metric, overlap_set in PRINTED_COLUMNS:
        cells = [means.get((metric, overlap_set, name), (math.nan, math.nan)) for name in DIFFICULTIES]
        if any((metric, overlap_set, name) in means for name in DIFFICULTIES):
            words = ["-" if math.isnan(mean) else f"{mean:.2f} ({spread:.2f})" for mean, spread in cells]
            rows.append([f"{overlap_set} {_NAMES[metric]}", *words])
    return markdown_table(["overlap set, metric", *DIFFICULTIES], rows)


def write_detection(
    folder: Path, curves: Sequence[Curve], *, about: dict[str, Any], mean: tuple[str, Means] | None = None
) -> None:
    """Writes detection.json (every average, precision and threshold), detection.md and a picture an overlap set.

    `mean` is what a mean is over, in words, and the means.
    """
    content = about | {"curves": [_plain(curve) for curve in curves]}
    if mean is not None:
        averages = [
            dict(zip(("metric", "overlap_set", "difficulty"), key, strict=True)) | {"ap_r40": value, "spread": spread}
            for key, (value, spread) in mean[1].items()
        ]
        content |= {"mean": {"of": mean[0], "averages": averages}}
    parts = [list_facts(about), *(detection_table(curves, average=average) for average in ("ap_r40", "ap_r11"))]
    if mean is not None:
        parts += [mean[0], mean_table(mean[1])]
    write_results(folder, "detection", content, text="\n\n".join(parts), indent=1)
    for overlap_set in OVERLAP_SETS:
        picture = precision_recall_picture(curves, overlap_set)
        words = f"Precision over recall, overlap set {overlap_set}"
        save_figure(folder, f"precision_recall_{overlap_set}", picture, words=words)


def _plain(curve: Curve) -> dict[str, Any]:
    return {
        "class": curve.kind,
        "difficulty": curve.difficulty,
        "metric": curve.metric,
        "overlap_set": curve.overlap_set,
        "min_overlap": curve.min_overlap,
        "labels": curve.truths,
        "detections": curve.detections,
        "unit": "%",
        "ap_r40": curve.ap_r40,
        "ap_r11": curve.ap_r11,
        "precision": curve.precision,
        "recall": curve.recall,
        "threshold": curve.threshold,
    }
