"""A report's account of both sides: where the sensor stood, by ranges alone, and what the frames could show."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from jaxsim.discover.verdict import Registered, Sensitivity
from jaxsim.effects import EFFECTS
from jaxsim.report.page import NOTHING, below, code, folded, paragraph, section, table, together
from jaxsim.report.words import number, percent, span, title_of


def where_it_stood(told: Registered | None) -> Markup:
    """The motion between the sides, if it is more than noise: a table of its numbers, and how far ranges then agree."""
    if told is None or not (told.sure or told.other_moments or told.speeds):
        return NOTHING
    meanings = {key: of.meaning for effect in EFFECTS.values() for key, of in effect.parameters.items()}
    rows = [[code(key), meanings[key], number(one.value), span(one), one.unit] for key, one in told.motion.items()]
    words = (
        "The sensor's motion from where the simulator has it, that makes ranges agree best over all frames. They agree "
        f"(within 0.5 m or 5 %) on {percent(told.near[1])} of the measured points as registered, on "
        f"{percent(told.near[0])} as given; half of the points lie within {number(told.off_m[1])} m and "
        f"{number(told.off_m[0])} m."
    )
    if told.other_moments:
        words += " Frames of one name are of different moments: each was brought to its own place."
    parts = [paragraph(words), table(["number", "meaning", "value", "90 % interval", "unit"], rows, text=2)]
    if told.speeds:
        drives = [[name, number(speed)] for name, speed in told.speeds.items()]
        parts.append(paragraph("Speeds that the frames' own distortion tells, where none is given:"))
        parts.append(table(["drive", "m/s"], drives, text=1))
    return section("Where the sensor stood", together(parts))


def could_show(asked: Sequence[Sensitivity]) -> Markup:
    """Effects that these frames could not show, why, and what to record; then the size from which each other one
    would be seen."""
    if not asked:
        return NOTHING
    hidden = [one for one in asked if not one.testable]
    words = (
        f"{len(asked)} effects were put on the rays that were compared, at half of a clearly visible size, and the "
        "gain was computed that naming could expect, nuisances being free to take up what they can. "
    )
    if hidden:
        words += "That none of the following is named says nothing about it:"
    else:
        words += "These scenes would show every one of them."
    rows = [[_name(one), one.why, one.record] for one in hidden]
    parts = [paragraph(words)]
    if rows:
        parts.append(table(["effect", "why it cannot be told here", "what to record"], rows, text=3))
    seen = [[_name(one), _from(one)] for one in asked if one.testable]
    if seen:
        heads = ["effect", "these scenes would show it from about"]
        parts.append(folded(f"From which size the other {len(seen)} would be seen", table(heads, seen, text=2)))
    return section("What these frames could show", together(parts))


def _name(one: Sensitivity) -> Markup:
    return below(code(one.name), title_of(one.name))


def _from(one: Sensitivity) -> str:
    """The smallest size, parameter by parameter; those that only shape the effect stay as they are."""
    known = EFFECTS.get(one.name)
    words = []
    for name, smallest in one.smallest.items():
        of = known.parameters.get(name) if known else None
        unit = f" {of.unit}" if of and of.unit else ""
        many = " (root mean square)" if of and of.shape != "scalar" else ""
        words.append(f"{name} {number(smallest)}{unit}{many}")
    return ", ".join(words)
