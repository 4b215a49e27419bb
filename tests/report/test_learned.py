"""A report's account of what was learned."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxsim.discover.verdict import ClosedLaw, Interval
from jaxsim.effects.learned import Learned
from tests.report import results
from tests.report.results import page

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
