"""A report's account of both sides: where the sensor stood, and what the frames could show."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from jaxsim.discover.verdict import Interval, Registered, Sensitivity
from jaxsim.report.sides import could_show, where_it_stood
from jaxsim.report.words import verdict_sentence
from tests.report import results
from tests.report.results import page

TURNED = Registered(
    motion={"yaw_rad": Interval(0.0174, 0.0170, 0.0178, "rad"), "x_m": Interval(0.004, -0.006, 0.014, "m")},
    sure=("extrinsic_rotation",),
    other_moments=False,
    near=(0.82, 0.96),
    off_m=(0.31, 0.02),
)
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


def test_a_turned_sensor_is_told_with_its_numbers_and_what_they_mend(tmp_path: Path):
    result = results.named()
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, registered=TURNED)))
    assert "Where the sensor stood" in text
    assert "0.0170 to 0.0178" in text
    assert "on 96 % of the measured points as registered, on 82 % as given" in text
    assert "So registered, ranges agree on 96 % of the points, as given on 82 %." in text


@pytest.mark.parametrize("told", [None, replace(TURNED, sure=())])
def test_a_sensor_in_its_place_needs_no_words(told):
    assert where_it_stood(told) == ""
    verdict = results.named().verdict
    assert verdict_sentence(replace(verdict, registered=told)) == verdict_sentence(verdict)


def test_frames_of_other_moments_and_speeds_are_told():
    text = where_it_stood(replace(TURNED, sure=(), other_moments=True, speeds={"drive 1": 7.5}))
    assert "Frames of one name are of different moments" in text
    assert "drive 1" in text
    assert "7.50" in text


def test_sides_without_a_relation_are_told_in_the_answer():
    verdict = replace(results.named().verdict, unrelated=True, registered=replace(TURNED, other_moments=True))
    sentence = verdict_sentence(verdict)
    assert "have no relation to each other" in sentence
    assert "are of other moments than the simulated ones" in sentence


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
