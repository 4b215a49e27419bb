"""Free curves: which are believed, and what they are called."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.find.covariates import CURVES, PRODUCTS, Dependence
from jaxsim.discover.name import unexplained
from jaxsim.discover.name.unexplained import agreed, shape_of
from jaxsim.effects.learned import OFFSET
from tests.discover.name.made import candidate, fitted, problem


@pytest.mark.parametrize(
    ("y", "character"),
    [
        (lambda x: 0.3 * x, "monotone"),
        (lambda x: np.where(x < 2, 0.0, 0.4), "step"),
        (lambda x: 0.3 * np.sin(3 * 2 * np.pi * x / 4), "periodic"),
    ],
)
def test_a_curve_is_called_what_it_looks_like(y, character):
    x = np.linspace(0, 4, 40)
    assert shape_of(x, y(x), np.ones(40), dependence=Dependence("intensity", "range", 0.01, 0.1, 50.0))[0] == character


def test_a_bend_over_nearly_all_rays_is_no_wave_for_a_few_far_off():
    """Knots at the intensities of a street, one at that of its single darkest ray."""
    x = np.array([-9.2, -2.8, -2.5, -2.3, -2.1, -1.8, -1.5, -1.2, -1.0, -0.8, -0.6, 0.0])
    y = np.where(x < -9, 0.0, 0.38 * np.tanh(2 * (x + 1.1)))
    along = Dependence("intensity", "intensity", 0.01, 0.1, 50.0)
    assert shape_of(x, y, np.ones(12), dependence=along)[0] == "periodic"
    assert shape_of(x, y, np.ones(12), dependence=along, span=2.8)[0] != "periodic"


@pytest.mark.parametrize(
    ("strongest", "added"),
    [
        (["row", "range"], ["row", "even rows"]),
        (["even rows", "row", "range"], ["even rows", "row"]),
        (["even columns"], ["even columns"]),
        (["range", "incidence", "power", "row"], []),  # three are tried
    ],
)
def test_additions_are_tried_where_intensities_follow_the_readout(monkeypatch, strongest, added):
    tried = []

    def rank(problem, laws, *, null_fits, bar):
        tried.append((problem, laws[0].name))
        return [candidate("curve", 1)]

    monkeypatch.setattr(unexplained, "rank_effects", rank)
    monkeypatch.setattr(unexplained, "with_basis", lambda problem, covariate, steps: covariate)
    monkeypatch.setattr(unexplained, "_varies", lambda problem, covariate: False)
    along = [Dependence("intensity", name, 0.01, 0.1, 50.0) for name in strongest]
    curves = unexplained.free_curves(problem(null_fits=()), along)
    assert sorted(name for name, law in tried if law == "offset curve") == sorted(added)
    # And the product that is tried whatever residuals show.
    assert "range x incidence" in {name for name, _ in tried}
    assert len(curves) == len(tried) == min(len(strongest), 3) + len(added) + len(PRODUCTS["intensity"])


def test_a_wave_of_one_turn_is_a_wave():
    azimuth = np.linspace(-3.1, 3.1, 20)
    along = Dependence("range", "azimuth", 0.01, 0.1, 50.0)
    character, formula = shape_of(azimuth, 0.06 * np.cos(azimuth + 0.7), np.ones(20), dependence=along)
    assert character == "periodic"
    assert "0.06·sin(1·x" in formula
    # Over half a turn it is no whole wave.
    assert "sin(1·x" not in shape_of(azimuth / 2, np.cos(azimuth), np.ones(20), dependence=along)[1]


@pytest.mark.parametrize(("covariate", "told"), [("even rows", ("row", "even rows")), ("row", ("row", ""))])
def test_a_curve_keeps_the_covariate_that_its_formula_is_of_beside_the_name_of_the_coarser_one(covariate, told):
    row = np.arange(40) % 8
    rays = SimpleNamespace(hit=np.ones(40, bool), row=row)
    fits = tuple(replace(fitted(), z={"height": np.full(36, 0.1 * k, np.float32)}) for k in range(3))
    curve = replace(candidate("curve", 4.0), effect=CURVES["intensity"], fits=fits)
    along = Dependence("intensity", covariate, 0.01, 0.1, 50.0)
    found = unexplained.describe_curve(problem(ev=SimpleNamespace(rays=rays)), along, curve)
    assert (found.covariate, found.along) == told


def test_what_is_added_is_told_in_the_intensitys_own_unit():
    along = Dependence("intensity", "even rows", 0.01, 0.1, 50.0, adds=True)
    told = shape_of(np.array([0.0, 1.0]), np.array([0.002, 0.05]), np.ones(2), dependence=along)
    assert told == ("periodic", "Δ I ≈ +0.05 on odd rows, +0.002 on even ones")


def test_scenes_must_agree_on_a_free_curve_more_than_on_an_effect():
    steady = np.array([4.0, 5, 3, 6, 4, 5, 2, 4, 3, 5, 6])
    against = np.where(np.arange(11) == 3, -6.0, steady)
    assert 0.005 < candidate("beam_gain", against).chance <= 0.02
    assert agreed(candidate("beam_gain", steady))
    assert candidate("beam_gain", against).accepted()
    assert not agreed(candidate("beam_gain", against))
    # Of seven scenes no more than all can agree.
    assert agreed(candidate("beam_gain", steady[:7], scenes=7))


@pytest.mark.parametrize(("height", "said"), [(0.00006, False), (0.004, True)])
def test_an_addition_that_rounding_near_0_makes_is_no_curve(height, said):
    curve = CURVES[OFFSET]
    z = height / curve.parameters["height"].scale
    fits = (replace(fitted(), z={"height": np.array([z, -z / 2])}),)
    assert agreed(replace(candidate("beam_gain", 5), effect=curve, fits=fits)) == said
