"""What CI reads of a gate."""

import xml.etree.ElementTree as ET
from dataclasses import replace

from jaxsim.discover.gate import Check
from jaxsim.report.gates import junit, markdown

CHECKS = (
    Check("intensity", "pass", "0.01 of 0.10"),
    Check("range", "gap", "0.3 m of 0.05 m"),
    Check("drop", "gap", "0.2 of 0.1"),
    Check("comparison", "unsure", "a & b share <no> frame"),
)


def test_junit_counts_failures_and_errors():
    suite = ET.fromstring(junit(CHECKS, seconds=3.14))
    assert int(suite.get("tests")) == len(suite) == len(CHECKS)
    assert int(suite.get("failures")) == len(suite.findall("testcase/failure")) == 2
    assert int(suite.get("errors")) == len(suite.findall("testcase/error")) == 1
    assert suite.find("testcase/error").text == CHECKS[3].words


def test_the_table_has_a_line_a_check():
    lines = markdown(CHECKS, title="It lacks something").splitlines()
    assert lines[0] == "## It lacks something"
    assert [check.name for check in CHECKS] == [line.split(" | ")[0].removeprefix("| ") for line in lines[4:]]
    assert "**gap**" in lines[5]


def test_what_a_terminal_is_told_of_colours_is_no_xml():
    check = replace(CHECKS[0], words="\x1b[31mred\x01")
    assert "red" in "".join(ET.fromstring(junit([check], seconds=1.0)).itertext())
