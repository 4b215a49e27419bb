"""A report's account of both sides: where the sensor stood, and what the frames could show."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxsim.discover.verdict import ClosedLaw, Interval, Registered, Sensitivity
from jaxsim.effects.learned import Learned
from jaxsim.report.accounts import could_show, where_it_stood
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
    why="levels of classes, streets and surfaces take up 99 % of what it does",
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
    told = "could not have shown retroreflection at half of a clearly visible size: what to record"
    assert told in verdict_sentence(verdict)
    text = page(tmp_path, replace(result, verdict=verdict))
    assert "What these frames could show" in text
    assert "its surfaces &amp; many of them" in text
    assert "exponent 0.1" in text


def test_frames_that_show_everything_leave_nothing_to_record():
    assert "would show every one" in could_show((SEEN,))
    assert "could not have shown" not in verdict_sentence(replace(results.none().verdict, sensitivity=(SEEN,)))
    assert could_show(()) == ""


def test_what_is_named_is_not_listed_as_what_could_not_be_shown():
    assert "its surfaces" in could_show((HIDDEN,))
    assert "its surfaces" not in could_show((HIDDEN,), [HIDDEN.name])
    verdict = results.named().verdict
    named = replace(HIDDEN, name=verdict.effects[0].name)
    assert replace(verdict, sensitivity=(HIDDEN, named)).not_testable == (HIDDEN,)


def test_verdict_json_lists_what_cannot_be_told(tmp_path: Path):
    verdict = replace(results.none().verdict, sensitivity=(HIDDEN, SEEN))
    content = json.loads(verdict.save(tmp_path).read_text())
    assert content["not_testable"] == [{"name": "retroreflection", "why": HIDDEN.why, "record": HIDDEN.record}]
    assert [one["smallest"] for one in content["sensitivity"]] == [{}, {"exponent": 0.1}]


X = tuple(np.linspace(0.5, 4.3, 19).tolist())
WAVE = Learned("intensity", "curve", ("range",), (X,), tuple((0.2 * np.sin(6 * np.array(X))).tolist()), (0.02,) * 19)
FORMULA = ClosedLaw(
    "intensity",
    ("range",),
    "0.01 + 0.2·sin(2·π·range_m / 12 + 0.4)",
    "level + size * sin(2 * pi * range_m / period + phase)",
    {"period": Interval(12.0, 11.5, 12.5, "m")},
    {"range_m": (1.6, 74.0)},
    2,
    41.0,
    0.93,
)


def test_a_learned_law_is_drawn_with_its_formula_and_what_it_gains(tmp_path: Path):
    result = results.not_in_catalogue()
    gap = results.named().verdict.gap
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, learned=(WAVE,), law=FORMULA, gap=gap)))
    assert "What was learned and added" in text
    assert "a curve of 19 heights of intensity along range" in text
    assert "gains 180 nats per scene (90 % interval 150 to 210)" in text
    assert "0.01 + 0.2·sin(2·π·range_m / 12 + 0.4)" in text
    assert "tells 93 % of the law" in text
    assert (tmp_path / "figures" / "learned_intensity_range.svg").read_text().count("<circle") == 19
    page(tmp_path, result)
    assert not (tmp_path / "figures" / "learned_intensity_range.svg").exists()


def test_a_product_is_told_in_words(tmp_path: Path):
    result = results.not_in_catalogue()
    law = Learned("drop", "product", ("range", "hue"), ((1.0, 2.0), (0.0, 1.0)), (0.1,) * 4, (0.0,) * 4)
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, learned=(law,))))
    assert "a product of 4 heights of drop along range and hue" in text


def test_a_wave_over_columns_is_told_in_words(tmp_path: Path):
    text = page(tmp_path, results.repeating())
    assert "a wave of 2 heights of intensity along column. They are those of its cosine and its sine." in text


def test_two_laws_of_one_covariate_have_a_figure_each(tmp_path: Path):
    result = results.not_in_catalogue()
    page(tmp_path, replace(result, verdict=replace(result.verdict, learned=(WAVE, WAVE))))
    assert {path.stem for path in (tmp_path / "figures").glob("learned*")} == {
        "learned_intensity_range",
        "learned_intensity_range_1",
    }
