"""A gate's checks as JUnit XML, which CI systems show, and as Markdown for a summary."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from jaxsim.discover.gate import Check, Colour
from jaxsim.files import write_text

_WORDS: dict[Colour, str] = {"pass": "pass", "gap": "**gap**", "unsure": "could not judge"}


def junit(checks: Sequence[Check], *, seconds: float) -> str:
    """A test suite with a case a check: a gap is a failure, what could not be judged an error."""
    counts = {colour: sum(check.colour == colour for check in checks) for colour in _WORDS}
    suite = ET.Element(
        "testsuite",
        name="jaxsim discover",
        tests=str(len(checks)),
        failures=str(counts["gap"]),
        errors=str(counts["unsure"]),
        time=f"{seconds:.1f}",
    )
    for check in checks:
        case = ET.SubElement(suite, "testcase", classname="jaxsim.discover", name=check.name)
        if check.colour == "pass":
            ET.SubElement(case, "system-out").text = check.words
        else:
            kind = "failure" if check.colour == "gap" else "error"
            ET.SubElement(case, kind, message=check.words).text = check.words
    return ET.tostring(suite, encoding="unicode", xml_declaration=True)


def markdown(checks: Sequence[Check], *, title: str) -> str:
    """A table of the checks."""
    rows = [f"| {check.name} | {_WORDS[check.colour]} | {check.words} |" for check in checks]
    return "\n".join([f"## {title}", "", "| check | | |", "|---|---|---|", *rows, ""])


def write_gate(out: Path, checks: Sequence[Check], *, title: str, seconds: float) -> None:
    """Writes OUT/junit.xml and OUT/gate.md."""
    write_text(out / "junit.xml", junit(checks, seconds=seconds))
    write_text(out / "gate.md", markdown(checks, title=title))
