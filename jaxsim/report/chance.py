"""What the data give by chance: gains on nulls drawn from them, beside those of the measurement."""

from __future__ import annotations

from jaxsim.discover.verdict import Nulls, Verdict
from jaxsim.report.canvas import AFTER, BEFORE, FAINT, RULE, Canvas
from jaxsim.report.charts import label, ticks
from jaxsim.report.page import Draw, paragraph, section
from jaxsim.report.words import number

LEFT, RIGHT = 96, 700
BOTTOM = 112
FAN = 4.0
"""Pixels between neighbours of a row, in turn up and down, so that equal gains do not hide one another."""


def chance(verdict: Verdict, draw: Draw) -> str:
    """How often naming errs on these very data, if nulls were drawn; else nothing."""
    nulls = verdict.nulls
    if nulls is None:
        return ""
    count = len(nulls.gains)
    words = (
        f"{count} measurements in which nothing is missing were drawn (this simulation with what is left of these "
        "data, its sign changed scene by scene) and named in like the measured one. On "
        f"{nulls.answered} of them something would have been said with the bar that was set on other streets. Here an "
        f"effect must gain more than the strongest on any of them ({number(nulls.bar)} nats a scene), a free curve "
        f"more than any did ({number(nulls.free_bar)})."
    )
    caption = (
        f"Gains that pass every test but the bar, nats a scene. Below: of the strongest effect on each of {count} "
        "nulls; above: of the candidates on the measurement, filled if named. The line is the bar."
    )
    return section(
        "What chance gives on these data", paragraph(words) + draw("chance", null_strip(nulls, verdict), caption)
    )


def null_strip(nulls: Nulls, verdict: Verdict) -> Canvas:
    """Two rows of dots on one axis, and the bar as a line."""
    named = {effect.name for effect in verdict.effects}
    rows = (
        ("measured", 34, [(max(rank.gain, 0.0), rank.name in named) for rank in verdict.ranking]),
        ("nulls", 82, [(gain, False) for gain in nulls.gains]),
    )
    reach = 1.05 * max([1.5 * nulls.bar, *(gain for _, _, dots in rows for gain, _ in dots)])
    canvas = Canvas(720, 158)

    def across(gain: float) -> float:
        return LEFT + gain / reach * (RIGHT - LEFT)

    canvas.line([(LEFT, BOTTOM), (RIGHT, BOTTOM)], colour=RULE)
    for value in ticks(0, reach, 6):
        canvas.line([(across(value), BOTTOM), (across(value), BOTTOM + 4)], colour=FAINT)
        canvas.text(across(value), BOTTOM + 17, label(value), anchor="middle", size=11, colour=FAINT)
    canvas.text((LEFT + RIGHT) / 2, BOTTOM + 36, "gain, nats a scene", anchor="middle", size=12)
    canvas.line([(across(nulls.bar), 12), (across(nulls.bar), BOTTOM)], colour=BEFORE, width=1.5)
    for name, y, dots in rows:
        canvas.text(LEFT - 14, y + 4, name, anchor="end", size=12)
        for k, (gain, strong) in enumerate(dots):
            canvas.dot(across(gain), y + FAN * (k % 5 - 2), colour=AFTER, radius=4, hollow=not strong)
    return canvas
