"""A report's account of what is missing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup

from jaxsim.discover.verdict import Interval, Unexplained
from jaxsim.discover.verdict.names import NAMED
from jaxsim.effects.rays import covariates
from jaxsim.report.named import unexplained
from jaxsim.report.words import AXES
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


@pytest.mark.parametrize(
    ("along", "label", "shown"),
    [
        ("hue angle", "hue angle of the camera pixel, °", "171.887"),
        ("speed x time", "speed times place within the scan", "3"),
        ("even rows", "0 on even rows, 1 on odd ones", "3"),
        ("", "brightness of the camera pixel, 0..1", "3"),
    ],
)
def test_a_curve_along_a_finer_look_at_a_covariate_has_the_axis_of_what_its_formula_calls_x(along, label, shown):
    charts = []

    def draw(name, chart, caption):
        charts.append(chart)
        return Markup("")

    formula = f"Δ ln I ≈ 0.1·sin(2·x +0) (x: {along})"
    curve = Unexplained("intensity", NAMED.get(along, "rgb"), "periodic", formula, (-3.0, 0.0, 3.0), (0.1, 0.0, -0.1))
    text = unexplained(replace(curve, along=along), draw)
    assert label.removesuffix(", °") in text
    assert label in charts[0].rows[0][0]
    assert charts[0].rows[-1][0] == shown


def test_every_covariate_of_rays_has_an_axis():
    assert set(covariates(np)) <= set(AXES)
