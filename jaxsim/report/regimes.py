"""A report's account of regimes, effects that act in a part of the recording alone: where, how large there and outside,
and a strip along what divides, on which a moment shows a judge frame and a sector lights its rays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Int
from markupsafe import Markup

from jaxsim.discover.verdict import JudgeFrame, Regime
from jaxsim.report import page
from jaxsim.report.canvas import AFTER, BEFORE, FAINT, INK, RULE, Canvas
from jaxsim.report.charts import Coordinate, label, scaled, ticks, x_axis
from jaxsim.report.page import EMPTY, DrawChart, code, number, percent, probability
from jaxsim.report.words import part_of, span

LEFT = 72
RIGHT = 706
TOP = 30
BOTTOM = 148
MARK = 5.0
"""Half the width of a judge frame's mark, pixels."""
MOST_SIZE = 2.5
"""Size that the axis reaches at most: a scene that tells little may ask for any."""


def regimes(acting: Sequence[Regime], draw: DrawChart, *, frames: Sequence[JudgeFrame] = ()) -> Markup:
    """Each effect that acts in a part alone: where, how large there and outside, and a strip along what divides.
    `frames` are those that the page shows ray by ray."""
    if not acting:
        return EMPTY
    rows = [
        [
            code(one.effect),
            part_of(one),
            percent(one.share),
            page.below(number(one.inside.value), span(one.inside)),
            page.below(number(one.outside.value), span(one.outside)),
            probability(one.p_value),
            probability(one.q_value),
            number(one.judge_nats),
            "yes" if one.applied else "no: frames do not say where",
        ]
        for one in acting
    ]
    words = (
        "These effects act in a part of the recording alone, and their parameters were fitted there. Sizes are in "
        "units of that fit: 0 is none of the effect, 1 all of it (90 % intervals, the scatter between scenes). p: that "
        "chance makes scenes differ so much in some region of the kind; q: rate of false discoveries over all that was "
        "asked. Judge scenes: nats that they gain over the same effect everywhere."
    )
    heads = ["effect", "acts", "share", "inside", "outside", "p", "q", "judge scenes", "in simulations"]
    legend = page.key([("inside", "after", False), ("outside", "before", True)])
    strips = [_strip(one, draw, ordinal=k, frames=frames) for k, one in enumerate(acting)]
    table = page.table(heads, rows, text=2, last_text=True)
    return page.section("Where and when it acts", words, table, legend, *strips)


def _strip(one: Regime, draw: DrawChart, *, ordinal: int, frames: Sequence[JudgeFrame]) -> Markup:
    what = "sector" if one.divides == "azimuth" else "scene"
    caption = (
        f"{one.effect}, which acts {part_of(one)} (shaded): the size that each {what} asks for. "
        "At 1 it is as large as fitted inside, at 0 it is not there."
    )
    if frames and one.divides == "azimuth":
        caption += " A click on a sector lights its rays."
    elif frames and _timed(one):
        caption += " Marks above: the judge frames of this page; a click on a moment shows the one that is nearest."
    return draw(page.file_name("regime", one.effect), strip_chart(one, ordinal=ordinal, frames=frames), caption)


def picks_of(acting: Sequence[Regime], frame: JudgeFrame, *, columns: int) -> Mapping[str, Int[np.ndarray, " n"]]:
    """By what the viewer picks, the sector of each ray in each strip along azimuth."""
    # Sectors are equal numbers of columns, as the regimes' questions cut them.
    sectors = {k: len(one.x) for k, one in enumerate(acting) if one.divides == "azimuth"}
    return {_picked(k): frame.column * count // columns for k, count in sectors.items()}


def _picked(ordinal: int) -> str:
    """The name by which the viewer picks sectors of a strip."""
    return f"regime {ordinal}"


def title(frame: JudgeFrame) -> str:
    """A frame's name with its scene."""
    return f"{frame.scene}, frame {frame.name}" if frame.scene not in ("", frame.name) else f"frame {frame.name}"


def _timed(one: Regime) -> bool:
    """Whether a strip runs along time, and not over azimuth or over scenes by number."""
    return one.divides != "azimuth" and not one.counted


def strip_chart(one: Regime, *, ordinal: int = 0, frames: Sequence[JudgeFrame] = ()) -> Canvas | None:
    """Sizes along what divides, those inside filled; None where nothing tells them. `place` is its number among the
    regimes; moments that `frames` lie nearest to, and sectors, answer to a click."""
    around = one.divides == "azimuth"
    x = np.rad2deg(one.x) if around else np.array(one.x, float)
    size = np.clip(np.array(one.sizes, float), -MOST_SIZE + 1, MOST_SIZE)
    known = np.isfinite(size)
    if not known.any():
        return None
    shown = [(k, frame) for k, frame in enumerate(frames) if _timed(one)]
    ends = [*x.tolist(), *(frame.time_s for _, frame in shown)]
    room = 0.03 * (max(ends) - min(ends)) or 1.0
    first, last = min(ends) - room, max(ends) + room
    low, high = min(-0.5, float(size[known].min()) - 0.1), max(1.5, float(size[known].max()) + 0.1)
    canvas = Canvas(720, 194)
    # Azimuth is shown as the image has it: left is left.
    across = scaled((last, first) if around else (first, last), (LEFT, RIGHT))
    up = scaled((low, high), (BOTTOM, TOP))
    for left, right in _inside(x, one.held, ends=(first, last), turn=around):
        corners = [(across(at), y) for at, y in ((left, TOP), (right, TOP), (right, BOTTOM), (left, BOTTOM))]
        canvas.area(corners, colour=AFTER, opacity=0.12)
    for value in (0.0, 1.0):
        canvas.line([(LEFT, up(value)), (RIGHT, up(value))], colour=RULE)
        canvas.text(LEFT - 8, up(value) + 4, label(value), anchor="end", size=11, colour=FAINT)
    words = "azimuth, ° (grows to the left)" if around else "time since the first frame, s"
    if not around and not _timed(one):
        words = "number of the scene"
    marks = ticks(first, last, 7, whole=not around and not _timed(one))
    x_axis(canvas, across, marks, left=LEFT, right=RIGHT, bottom=BOTTOM, words=words)
    canvas.text(16, (TOP + BOTTOM) / 2, "size", anchor="middle", size=12, turned=True)
    for at, value, held in zip(x.tolist(), size.tolist(), one.held, strict=True):
        if np.isfinite(value):
            canvas.dot(across(at), up(value), colour=AFTER if held else BEFORE, radius=4, hollow=not held)
    heads = ("azimuth, °" if around else words, "size", "acts there")
    points = zip(x.tolist(), one.sizes, one.held, strict=True)
    canvas.rows = [
        heads,
        *((label(round(at, 1)), number(value), "yes" if held else "no") for at, value, held in points),
    ]
    if around and frames:
        _sector_targets(canvas, x, across, ordinal=ordinal)
    else:
        _frame_targets(canvas, one, shown, across=across, ends=(first, last))
    return canvas


def _inside(x: np.ndarray, held: Sequence[bool], *, ends: tuple[float, float], turn: bool) -> list[tuple[float, float]]:
    """From and to of the stretches where it acts: up to halfway to the next place where it does not."""
    order = np.argsort(x)
    rims = (x[order][1:] + x[order][:-1]) / 2
    # Of a turn the last sector ends where it began, and not at the chart's rim.
    half = (rims[0] - x[order][0] if len(rims) else 1.0) if turn else np.inf
    first, last = max(ends[0], x.min() - half), min(ends[1], x.max() + half)
    edges = np.array([first, *rims, last])
    flags = np.array(held, int)[order]
    changes = np.diff(np.concatenate([[0], flags, [0]]))
    begins = edges[changes == 1].tolist()
    stops = edges[changes == -1].tolist()
    return list(zip(begins, stops, strict=True))


def _sector_targets(canvas: Canvas, x: np.ndarray, across: Coordinate, *, ordinal: int) -> None:
    half = abs(across(float(np.max(x))) - across(float(np.min(x)))) / max(len(x) - 1, 1) / 2 or 6.0
    for k, at in enumerate(x.tolist()):
        words = f"sector about {label(round(at))}° of azimuth"
        canvas.target(_picked(ordinal), k, words, x=across(at) - half, y=TOP, width=2 * half, height=BOTTOM - TOP)


def _frame_targets(
    canvas: Canvas,
    one: Regime,
    frames: Sequence[tuple[int, JudgeFrame]],
    *,
    across: Coordinate,
    ends: tuple[float, float],
) -> None:
    """A mark above each judge frame's moment, and the stretch that lies nearest to it as its target."""
    ordered = sorted(frames, key=lambda pair: pair[1].time_s)
    times = [frame.time_s for _, frame in ordered]
    rims = [ends[0], *((a + b) / 2 for a, b in pairwise(times)), ends[1]]
    for position, (k, frame) in enumerate(ordered):
        at = across(frame.time_s)
        left = across(rims[position])
        right = across(rims[position + 1])
        canvas.area([(at - MARK, TOP - 16), (at + MARK, TOP - 16), (at, TOP - 6)], colour=INK)
        acts = ""
        if one.where.time_s:
            acts = ": acts" if bool(one.where.in_time(np.float32(frame.time_s))) else ": does not act"
        words = f"{title(frame)}, {number(frame.time_s)} s{acts}"
        canvas.target("scene", k, words, x=left, y=TOP - 20, width=right - left, height=BOTTOM - TOP + 20)
