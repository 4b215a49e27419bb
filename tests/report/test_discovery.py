from dataclasses import replace
from html import unescape
from pathlib import Path

import cv2
import numpy as np
import pytest

from jaxsim.discover.verdict import Interval, Nulls, Result
from jaxsim.report import verdict_sentence, write_report
from jaxsim.report.words import number
from tests.report import results


def page(folder: Path, result: Result) -> str:
    return write_report(folder, result).read_text(encoding="utf-8")


@pytest.mark.parametrize("make", [results.named, results.none, results.not_in_catalogue])
def test_the_page_says_the_answer_and_loads_nothing_from_elsewhere(tmp_path: Path, make):
    result = make()
    text = page(tmp_path, result)
    assert verdict_sentence(result.verdict) in unescape(text)
    assert "http" not in text
    assert "<script" not in text
    assert "<link" not in text
    assert text.count("href=") == text.count('href="data:image/png;base64,')
    assert "nan" not in text.replace("nanometre", "")


def test_every_chart_of_the_page_is_a_figure_too(tmp_path: Path):
    text = page(tmp_path, results.named())
    figures = sorted(path.stem for path in (tmp_path / "figures").glob("*.png"))
    assert figures == ["curve_intensity_row", "map_drop", "map_intensity", "map_range", "parameter_beam_gain_gain"]
    assert text.count("<figure>") == len(figures)
    for path in (tmp_path / "figures").iterdir():
        assert cv2.imread(str(path)).std() > 5


def test_what_chance_gives_is_drawn_where_nulls_were_asked_for(tmp_path: Path):
    assert "What chance gives" not in page(tmp_path, results.named())
    result = results.named()
    nulls = Nulls(("oren_nayar", "", "saturation"), (1.4, 0.0, 0.3), (0.0, 0.0, 0.9), 1, 1.4, 0.9)
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, nulls=nulls)))
    assert "3 measurements in which nothing is missing" in text
    assert "On 1 of them something would have been said" in text
    assert f"({number(1.4)} nats a scene)" in text
    assert cv2.imread(str(tmp_path / "figures" / "chance.png")).std() > 5
    page(tmp_path, result)
    assert not (tmp_path / "figures" / "chance.png").exists()


def test_figures_of_an_earlier_answer_do_not_stay_and_other_files_do(tmp_path: Path):
    page(tmp_path, results.named())
    (tmp_path / "figures" / "mine.png").write_bytes(b"mine")
    page(tmp_path, results.not_in_catalogue())
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert "curve_intensity_row.png" not in names
    assert {"mine.png", "unexplained_intensity_range.png"} <= names


def test_names_are_escaped(tmp_path: Path):
    text = page(tmp_path, results.named())
    assert "drive &lt;b&gt;3&lt;/b&gt; &amp; Co" in text
    assert "<b>3</b>" not in text


def test_the_page_tells_the_look_alike_and_what_would_separate_it(tmp_path: Path):
    text = page(tmp_path, results.named())
    assert "focal_compensation" in text
    assert "follow one beam over range" in text
    assert "Runner-up, look-alikes left out: range_falloff" in text


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
    assert (tmp_path / "figures" / "curve_range_row_spread.png").is_file()
    assert (tmp_path / "figures" / "curve_intensity_row.png").is_file()


def test_effects_and_covariates_that_the_catalogue_does_not_know_are_drawn_all_the_same(tmp_path: Path):
    result = results.named()
    strange = replace(result.verdict.effects[0], name="new_effect", parameters={"a b": (Interval(1.0, 0.5, 1.5, ""),)})
    curve = replace(result.curves[0], covariate="moon phase")
    result = replace(result, verdict=replace(result.verdict, effects=(strange,)), curves=(curve,))
    assert "moon phase" in page(tmp_path, result)
    assert (tmp_path / "figures" / "parameter_new_effect_a-b.png").is_file()


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


def test_a_sure_but_tiny_change_is_no_change(tmp_path: Path):
    result = results.named()
    gap = dict(result.verdict.gap)
    gap["range"] = replace(gap["range"], low=-2e-7, high=-4e-8)
    gap["drop"] = replace(gap["drop"], low=-0.02, high=-0.01)
    text = page(tmp_path, replace(result, verdict=replace(result.verdict, gap=gap)))
    assert [text.count(f"<small>{word}</small>") for word in ("shrank", "unchanged", "grew")] == [1, 1, 1]
