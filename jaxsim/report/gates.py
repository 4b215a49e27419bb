"""The files that tell CI of a gate: junit.xml, which CI systems show, and gate.md for a summary."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from jaxsim.discover.gate import Check, Colour
from jaxsim.report.results import markdown_table

TITLES: dict[Colour, str] = {
    "pass": "The simulation passes",
    "gap": "The simulation lacks something",
    "unsure": "This cannot be judged for certain",
}
WORDS: dict[Colour, str] = {"pass": "pass", "gap": "**gap**", "unsure": "could not judge"}
"""Of each colour, in the table of checks."""


NOT_IN_XML = r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
"""Characters that XML 1.0 cannot hold, as those by which a terminal is told colours."""


def junit(checks: Sequence[Check], *, seconds: float) -> str:
    """A test suite with a case a check: a gap is a failure, what could not be judged an error."""
    counts = {colour: sum(check.colour == colour for check in checks) for colour in WORDS}
    suite = ET.Element(
        "testsuite",
        name="jaxsim discover",
        tests=str(len(checks)),
        failures=str(counts["gap"]),
        errors=str(counts["unsure"]),
        time=f"{seconds:.1f}",
    )
    for check in checks:
        said = re.sub(NOT_IN_XML, "�", check.words)
        name = re.sub(NOT_IN_XML, "�", check.name)
        case = ET.SubElement(suite, "testcase", classname="jaxsim.discover", name=name)
        if check.colour == "pass":
            ET.SubElement(case, "system-out").text = said
        else:
            kind = "failure" if check.colour == "gap" else "error"
            ET.SubElement(case, kind, message=said).text = said
    return ET.tostring(suite, encoding="unicode", xml_declaration=True)


def markdown(checks: Sequence[Check], *, title: str, notes: Sequence[str] = ()) -> str:
    """A table of the checks, and under it the answer's notes."""
    rows = [(check.name, WORDS[check.colour], check.words) for check in checks]
    page = f"## {title}\n\n{markdown_table(('check', '', ''), rows)}\n"
    return page + "".join(("\n", *(f"- {note}\n" for note in notes))) if notes else page
