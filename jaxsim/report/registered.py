"""A report's account of where the sensor stood, by ranges alone."""

from __future__ import annotations

from markupsafe import Markup

from jaxsim.discover.verdict import Registered
from jaxsim.effects import EFFECTS
from jaxsim.report.page import NOTHING, code, paragraph, section, table, together
from jaxsim.report.words import number, percent, span


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
