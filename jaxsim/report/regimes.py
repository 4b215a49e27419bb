"""A report's account of regimes: effects that act in a part of the recording alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from jaxsim.discover.verdict import Regime
from jaxsim.report.canvas import AFTER, BEFORE, FAINT, RULE, Canvas
from jaxsim.report.charts import label, ticks, x_axis
from jaxsim.report.page import NOTHING, Draw, below, code, file_name, key, paragraph, section, table, together
from jaxsim.report.words import number, part_of, percent, probability, span

LEFT = 72
RIGHT = 706
TOP = 14
BOTTOM = 132
ALONG = {
    "azimuth": "azimuth, ° (grows to the left)",
    "time": "time since the first frame, s",
    "tag": "time since the first frame, s",
    "scene": "time since the first frame, s",
}
"""What a strip runs along; number of the scene where frames say no time."""
MOST = 2.5
"""Size that the axis reaches at most: a scene that tells little may ask for any."""


def regimes(found: Sequence[Regime], draw: Draw) -> Markup:
    """Each effect that acts in a part alone: where, how large there and outside, and a strip along what divides."""
    if not found:
        return NOTHING
    rows = [
        [
            code(one.effect),
            part_of(one),
            percent(one.share),
            below(number(one.inside.value), span(one.inside)),
            below(number(one.outside.value), span(one.outside)),
            probability(one.p_value),
            probability(one.q_value),
            number(one.judge_nats),
            "yes" if one.applied else "no: frames do not say where",
        ]
        for one in found
    ]
    words = (
        "These effects act in a part of the recording alone, and their parameters were fitted there. Sizes are in "
        "units of that fit: 0 is none of the effect, 1 all of it (90 % intervals, the scatter between scenes). p: that "
        "chance makes scenes differ so much in some region of the kind; q: rate of false discoveries over all that was "
        "asked. Judge scenes: nats that they gain over the same effect everywhere."
    )
    heads = ["effect", "acts", "share", "inside", "outside", "p", "q", "judge scenes", "in simulations"]
    legend = key([("inside", "after", False), ("outside", "before", True)])
    strips = together(_strip(one, draw) for one in found)
    body = paragraph(words) + table(heads, rows, text=2, last_text=True) + legend + strips
    return section("Where and when it acts", body)


def _strip(one: Regime, draw: Draw) -> Markup:
    what = "sector" if one.divides == "azimuth" else "scene"
    caption = (
        f"{one.effect}, which acts {part_of(one)}: the size that each {what} asks for, had the effect been fitted "
        "everywhere. At 1 it is as large as fitted inside, at 0 it is not there."
    )
    return draw(file_name("regime", one.effect), strip_chart(one), caption)


def strip_chart(one: Regime) -> Canvas | None:
    """Sizes along what divides, those inside filled; None where nothing tells them."""
    x = np.rad2deg(one.x) if one.divides == "azimuth" else np.array(one.x, float)
    size = np.clip(np.array(one.sizes, float), -MOST + 1, MOST)
    known = np.isfinite(size)
    if not known.any():
        return None
    canvas = Canvas(720, 178)
    room = 0.03 * float(np.ptp(x)) or 1.0
    first, last = float(x.min()) - room, float(x.max()) + room
    # Azimuth is shown as the image has it: left is left.
    ends = (last, first) if one.divides == "azimuth" else (first, last)
    low, high = min(-0.5, float(size[known].min()) - 0.1), max(1.5, float(size[known].max()) + 0.1)

    def across(value: float) -> float:
        return LEFT + (value - ends[0]) / (ends[1] - ends[0]) * (RIGHT - LEFT)

    def up(value: float) -> float:
        return BOTTOM - (value - low) / (high - low) * (BOTTOM - TOP)

    for value in (0.0, 1.0):
        canvas.line([(LEFT, up(value)), (RIGHT, up(value))], colour=RULE)
        canvas.text(LEFT - 8, up(value) + 4, label(value), anchor="end", size=11, colour=FAINT)
    marks = ticks(first, last, 7)
    x_axis(canvas, across, marks, left=LEFT, right=RIGHT, bottom=BOTTOM, words=ALONG[one.divides])
    canvas.text(16, (TOP + BOTTOM) / 2, "size", anchor="middle", size=12, turned=True)
    for place, value, held in zip(x.tolist(), size.tolist(), one.held, strict=True):
        if np.isfinite(value):
            canvas.dot(across(place), up(value), colour=AFTER if held else BEFORE, radius=4, hollow=not held)
    return canvas
