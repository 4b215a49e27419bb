"""Pictures of a run: who was named for what, and how often against severity."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.tables import of_kind, separable, wilson
from jaxsim.effects import EFFECTS
from jaxsim.report.canvas import AFTER, BEFORE, FAINT, INK, RULE, Canvas, save_figure

Row = dict[str, Any]

CELL, LEFT, TOP = 15, 190, 160
NOTHING, OUTSIDE, ERROR = "none", "not in catalogue", "error"
DARK = 0.55
"""Share from which a cell's number is written in white."""


def save_pictures(out: Path, rows: Sequence[Row]) -> None:
    """confusion.svg and power.svg; the second only where a single effect was hidden."""
    save_figure(out, "confusion", confusion(rows), words="What was named for what was hidden")
    if of_kind(rows, "single"):
        save_figure(out, "power", power(rows), words="Rates against severity")


def confusion(rows: Sequence[Row]) -> Canvas:
    """Shares of the first name (columns) of each single effect, of nulls, and of each kind outside (rows)."""
    columns = [*EFFECTS, NOTHING, OUTSIDE, ERROR]
    hidden: dict[str, Counter[str]] = {}
    for row in rows:
        if row["kind"] != "combination":
            name = row["truth"][0] if row["truth"] else f"none, {row['level']}"
            hidden.setdefault(name, Counter())[_first(row)] += 1
    order = {name: k for k, name in enumerate(EFFECTS)}
    names = sorted(hidden, key=lambda name: (name.startswith("outside"), order.get(name, len(order)), name))
    canvas = Canvas(LEFT + CELL * len(columns) + 60, TOP + CELL * len(names) + 20)
    canvas.text(LEFT - 10, 16, "named first, per cent of cases", size=13)
    canvas.text(10, TOP - 10, "hidden", size=13)
    for k, name in enumerate(columns):
        canvas.text(LEFT + (k + 0.5) * CELL + 4, TOP - 8, name.replace("_", " "), size=11, colour=FAINT, turned=True)
    for j, name in enumerate(names):
        y, total = TOP + j * CELL, sum(hidden[name].values())
        canvas.text(LEFT - 8, y + CELL - 4, name.replace("_", " "), anchor="end", size=11)
        canvas.text(LEFT + CELL * len(columns) + 8, y + CELL - 4, f"of {total}", size=10, colour=FAINT)
        for k, answer in enumerate(columns):
            share = hidden[name][answer] / total
            if share:
                right = answer == name or name.startswith(answer) or (answer, name[:7]) == (OUTSIDE, "outside")
                _cell(canvas, LEFT + k * CELL, y, share, AFTER if right else BEFORE)
    for k in range(len(columns) + 1):
        x = LEFT + k * CELL
        canvas.line([(x, TOP), (x, TOP + CELL * len(names))], colour="#e6e6e6", width=0.5)
    for j in range(len(names) + 1):
        y = TOP + j * CELL
        canvas.line([(LEFT, y), (LEFT + CELL * len(columns), y)], colour="#e6e6e6", width=0.5)
    return canvas


def _first(row: Row) -> str:
    if row["answer"]:
        return row["answer"][0]
    return {"none": NOTHING, "not_in_catalogue": OUTSIDE}.get(row["verdict"], ERROR)


def _cell(canvas: Canvas, x: float, y: float, share: float, colour: str) -> None:
    """Coloured by its share, from white; the number stays readable on it."""
    tone = [round(255 + (int(colour[k : k + 2], 16) - 255) * (0.15 + 0.85 * share)) for k in (1, 3, 5)]
    corners = [(x, y), (x + CELL, y), (x + CELL, y + CELL), (x, y + CELL)]
    canvas.area(corners, colour="#{:02x}{:02x}{:02x}".format(*tone))
    if share < DARK:
        canvas.text(x + CELL / 2, y + CELL - 4, f"{100 * share:.0f}", anchor="middle", size=8)


PANELS = (
    ("all effects", lambda row: True),
    ("separable effects", separable),
    ("intensity", lambda row: _channel(row) == "intensity"),
    ("range", lambda row: _channel(row) == "range"),
    ("return", lambda row: _channel(row) == "drop"),
    ("geometry", lambda row: _channel(row) == "geometry"),
)
WIDTH, HEIGHT, GAP = 250, 170, 56


def _channel(row: Row) -> str:
    effect = EFFECTS[row["truth"][0]]
    return "geometry" if effect.stage == "geometry" else effect.channels[0]


def power(rows: Sequence[Row]) -> Canvas:
    """Share of single hidden effects named first (blue) and held in the set (orange), with 95 % intervals."""
    single = of_kind(rows, "single")
    severities = sorted({row["severity"] for row in single})
    canvas = Canvas(3 * (WIDTH + GAP) + 20, 2 * (HEIGHT + GAP + 10) + 30)
    for k, (title, keep) in enumerate(PANELS):
        left, top = GAP + (k % 3) * (WIDTH + GAP), 34 + (k // 3) * (HEIGHT + GAP + 10)
        some = [row for row in single if keep(row)]
        per = len(some) / max(len(severities), 1)
        canvas.text(left, top - 10, f"{title} (cases a severity: {per:.0f})", size=12)
        _panel(canvas, left, top, severities, some)
    y = canvas.height - 12
    for x, colour, what in ((GAP, AFTER, "right name first"), (GAP + 170, BEFORE, "in the set")):
        canvas.line([(x, y - 4), (x + 24, y - 4)], colour=colour, width=2)
        canvas.text(x + 30, y, what, size=12)
    canvas.text(
        GAP + 340,
        y,
        "severity: 1 is the size worth caring about (benchmarks/blind/hidden/units.json)",
        size=11,
        colour=FAINT,
    )
    return canvas


def _panel(canvas: Canvas, left: float, top: float, severities: Sequence[float], rows: Sequence[Row]) -> None:
    log = np.log2(severities)
    low, high = log.min() - 0.3, log.max() + 0.3

    def across(value: float) -> float:
        return left + (np.log2(value) - low) / (high - low) * WIDTH

    def up(share: float) -> float:
        return top + (1 - share) * HEIGHT

    for share in (0, 0.25, 0.5, 0.75, 1):
        canvas.line([(left, up(share)), (left + WIDTH, up(share))], colour=RULE if share == 0 else "#e6e6e6")
        canvas.text(left - 6, up(share) + 4, f"{100 * share:.0f} %", anchor="end", size=10, colour=FAINT)
    for severity in severities:
        canvas.text(across(severity), top + HEIGHT + 15, f"{severity:g}", anchor="middle", size=10, colour=INK)
    # A little apart, so that neither interval hides the other.
    for part, colour, aside in (("in_set", BEFORE, 3), ("first_right", AFTER, -3)):
        points = []
        for severity in severities:
            good = [row[part] for row in rows if row["severity"] == severity]
            if good:
                x, share = across(severity) + aside, float(np.mean(good))
                bottom, upper = wilson(sum(good), len(good))
                canvas.line([(x, up(bottom)), (x, up(upper))], colour=colour, width=1)
                canvas.dot(x, up(share), colour=colour, radius=3)
                points.append((x, up(share)))
        if len(points) > 1:
            canvas.line(points, colour=colour, width=2)
