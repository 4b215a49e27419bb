"""A report's account of what the frames could show."""

import json
from dataclasses import replace
from pathlib import Path

from jaxsim.discover.verdict import Sensitivity
from jaxsim.report.sensitivity import could_show
from jaxsim.report.words import verdict_sentence
from tests.report import results
from tests.report.results import page

HIDDEN = Sensitivity(
    name="retroreflection",
    size={"gain": 0.75, "tolerance_rad": 0.15},
    nats=0.2,
    needed=11.0,
    taken=0.99,
    times=None,
    testable=False,
    why="levels of classes, streets and surfaces take up 99% of what it does",
    record="scenes that hold its surfaces & many of them",
)
SEEN = Sensitivity("range_falloff", {"exponent": 0.2}, 38.0, 10.5, 0.9, 0.5, testable=True, why="", record="")


def test_none_says_what_it_does_not_rule_out(tmp_path: Path):
    result = results.none()
    verdict = replace(result.verdict, sensitivity=(HIDDEN, SEEN))
    assert "could not have shown retroreflection: what to record" in verdict_sentence(verdict)
    text = page(tmp_path, replace(result, verdict=verdict))
    assert "What these frames could show" in text
    assert "its surfaces &amp; many of them" in text
    assert "exponent 0.1" in text


def test_frames_that_show_everything_leave_nothing_to_record():
    assert "would show every one" in could_show((SEEN,))
    assert "could not have shown" not in verdict_sentence(replace(results.none().verdict, sensitivity=(SEEN,)))
    assert could_show(()) == ""


def test_verdict_json_lists_what_cannot_be_told(tmp_path: Path):
    verdict = replace(results.none().verdict, sensitivity=(HIDDEN, SEEN))
    content = json.loads(verdict.save(tmp_path).read_text())
    assert content["not_testable"] == [{"name": "retroreflection", "why": HIDDEN.why, "record": HIDDEN.record}]
    assert [one["smallest"] for one in content["sensitivity"]] == [{}, {"exponent": 0.1}]
