"""A report's evidence, in the words and figures of the page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxsim.discover.verdict import Fidelity, Interval
from jaxsim.effects.learned import Learned
from jaxsim.report.evidence import objects
from tests.report import results
from tests.report.results import page


def test_a_small_share_is_told_as_such(tmp_path: Path):
    result = results.named()
    places = (*result.verdict.where, replace(result.verdict.where[0], covariate="rgb", share=0.001))
    assert "&lt; 1 %" in page(tmp_path, replace(result, verdict=replace(result.verdict, where=places)))


@pytest.mark.parametrize(
    ("low", "high", "word"),
    [(-0.0001, 0.02, "not worse"), (-0.02, 0.02, "may be worse"), (0.001, 0.02, "shrank"), (-0.02, -0.01, "grew")],
)
def test_the_page_says_whether_a_channel_is_worse(tmp_path: Path, low: float, high: float, word: str):
    result = results.named()
    gap = {name: replace(one, before=0.1, low=low, high=high) for name, one in result.verdict.gap.items()}
    assert f"<small>{word}</small>" in page(tmp_path, replace(result, verdict=replace(result.verdict, gap=gap)))


def test_a_channel_that_was_not_compared_leaves_a_line_instead_of_a_chart(tmp_path: Path):
    result = results.named()
    nothing = np.full((results.ROWS, results.COLUMNS), np.nan)
    gap = dict(result.verdict.gap)
    gap["drop"] = replace(gap["drop"], before=np.nan, after=np.nan, low=np.nan, high=np.nan, win_rate=np.nan)
    result = replace(
        result,
        verdict=replace(result.verdict, gap=gap),
        maps_before=result.maps_before | {"drop": nothing},
        maps_after=result.maps_after | {"drop": nothing},
    )
    text = page(tmp_path, result)
    assert "no ray could be compared" in text
    assert "not compared" in text
    assert "nan" not in text


def test_a_curve_of_the_spread_is_a_figure_of_its_own(tmp_path: Path):
    result = results.named()
    spread = replace(result.curves[0], channel="range", unit="spread over the one expected, less 1", spread=True)
    text = page(tmp_path, replace(result, curves=(*result.curves, spread)))
    assert "Range along row: spread over the one expected, less 1." in text
    assert (tmp_path / "figures" / "curve_range_row_spread.svg").is_file()
    assert (tmp_path / "figures" / "curve_intensity_row.svg").is_file()


@pytest.mark.parametrize(
    ("low", "high", "word"), [(2.0, 9.0, "gains"), (-9, -2, "loses"), (-9, 9, "undecided"), (-0.5, 0.7, "as before")]
)
def test_the_page_says_what_the_likelihood_of_judge_scenes_gains(tmp_path: Path, low: float, high: float, word: str):
    result = results.named()
    one = result.verdict.gap["intensity"]
    gap = {"intensity": replace(one, gained=replace(one.gained, low=low, high=high))}
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, gap=gap)))
    assert f"<small>{word}</small>" in text
    assert "nats per scene" in text


LAW = Learned("intensity", "curve", ("azimuth",), ((0.0, 1.0),), (0.0, 0.1), (0.01, 0.01))


@pytest.mark.parametrize("found", [{"learned": (LAW,)}, {"unconfirmed": results.named().verdict.effects}])
def test_what_a_law_or_an_unconfirmed_effect_does_is_shown_as_that_of_a_named_one(tmp_path: Path, found: dict):
    result = results.with_frames()
    told = ("before − after, 90 %", "<small>gains</small>", "Closure, gained", "→", "What moved when", "before → after")
    lone = replace(result.verdict, verdict="not_in_catalogue", effects=())
    text = page(tmp_path, replace(result, verdict=replace(lone, **found)))
    assert [words for words in told if words not in text] == []
    # A law takes no effect's place, so that no runner-up was put there instead.
    assert (">placebo</th>" in text) == ("unconfirmed" in found)
    assert not lone.changed
    text = page(tmp_path, replace(result, verdict=lone))
    assert [words for words in told if words in text] == []


def test_a_sure_but_tiny_change_is_no_change(tmp_path: Path):
    result = results.named()
    gap = dict(result.verdict.gap)
    gap["range"] = replace(gap["range"], low=-2e-7, high=-4e-8)
    gap["drop"] = replace(gap["drop"], low=-0.02, high=-0.01)
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, gap=gap)))
    assert [text.count(f"<small>{word}</small>") for word in ("shrank", "unchanged", "grew")] == [1, 1, 1]


def test_targets_show_errors_and_their_sign():
    one = Interval(12.34, 10.0, 14.5, "%")
    fewer = Interval(-35.8, -38.1, -33.5, "%")
    unknown = Interval(float("nan"), float("nan"), float("nan"), "%")
    page = objects([Fidelity("car", 31, points=one, points_more=fewer, intensity=unknown, intensity_more=unknown)])
    assert "car" in page
    assert "12.3 %" in page
    assert "10.0 to 14.5" in page
    assert "−35.8 %" in page
    assert "−38.1 to −33.5" in page
    assert not objects([])


def test_slopes_of_the_simulators_contrast_stand_with_their_intervals(tmp_path: Path):
    result = results.none()
    assert "The simulator&#39;s contrast" not in page(tmp_path / "follows", result)
    off = replace(result, verdict=replace(result.verdict, contrast=results.contrast()))
    told = page(tmp_path / "off", off)
    assert "The simulator&#39;s contrast" in told
    assert "what is usual at its angle and range of building" in told
    assert "0.150 to 0.250" in told
    assert "gained 40.0 nats each" in told
