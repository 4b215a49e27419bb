"""A report's account of what is missing."""

from dataclasses import replace
from pathlib import Path

from jaxsim.discover.verdict import Interval
from tests.report import results
from tests.report.results import page


def test_the_page_tells_the_look_alike_and_what_would_separate_it(tmp_path: Path):
    text = page(tmp_path, results.named())
    assert "focal_compensation" in text
    assert "follow one beam over range" in text
    assert "Runner-up, look-alikes left out: range_falloff" in text
    assert "changes the range by +2.1 cm in the mean, nine of ten by +0.8 cm to +5.0 cm" in text


def test_effects_and_covariates_that_the_catalogue_does_not_know_are_drawn_all_the_same(tmp_path: Path):
    result = results.named()
    strange = replace(result.verdict.effects[0], name="new_effect", parameters={"a b": (Interval(1.0, 0.5, 1.5, ""),)})
    curve = replace(result.curves[0], covariate="moon phase")
    result = replace(result, verdict=replace(result.verdict, effects=(strange,)), curves=(curve,))
    assert "moon phase" in page(tmp_path, result)
    assert (tmp_path / "figures" / "parameter_new_effect_a-b.svg").is_file()
