"""A closed formula for a learned curve: the right one, and none where there is none."""

import numpy as np
import pytest

from jaxsim.discover.law.search import Variable, search
from jaxsim.discover.verdict import ClosedLaw
from tests.discover.law.made_laws import AZIMUTH, RANGE, learned


def found(true, *variables, **given):
    return search(variables, *learned(true, **given), channel="intensity", unit="nats", free=len(true))


def law_of(true, *variables, **given) -> ClosedLaw:
    law = found(true, *variables, **given)
    assert law
    return law


def ranges(of, **given) -> ClosedLaw:
    return law_of(of(RANGE), Variable("range_m", "m", RANGE), **given)


def test_a_line_is_found_as_a_line_with_its_slope():
    law = ranges(lambda x: 0.01 * x)
    assert law.expression == "level + size * range_m"
    assert law.nodes == 1
    slope = law.parameters["size"]
    assert slope.low <= 0.01 <= slope.high
    assert slope.unit == "nats/m"
    assert law.share > 0.9


@pytest.mark.parametrize(("exponent", "size"), [(2.0, -2e-4), (-1.0, 2.0), (3.0, 4e-6)])
def test_a_power_is_found_as_a_power(exponent, size):
    law = ranges(lambda x: size * x**exponent)
    assert law.parameters["exponent"].value == exponent
    assert law.nodes == 2


def test_a_logarithm_an_exponential_and_a_step_are_found():
    assert "log(" in ranges(lambda x: 0.3 * np.log(x)).expression
    decay = ranges(lambda x: 0.6 * np.exp(-x / 10), sd=0.01)
    assert decay.parameters["scale"].low <= -10 <= decay.parameters["scale"].high
    assert decay.parameters["scale"].unit == "m"
    step = ranges(lambda x: 0.3 * (x > 20))
    assert step.parameters["edge"].value == pytest.approx(20, abs=2)
    assert step.formula.endswith("·(range_m ≥ 21.6)")


def test_a_sine_is_found_with_its_period():
    law = law_of(0.2 * np.sin(5 * AZIMUTH + 1), Variable("azimuth_rad", "rad", AZIMUTH))
    period, phase = law.parameters["period"], law.parameters["phase"]
    assert period.value == pytest.approx(2 * np.pi / 5, rel=0.02)
    assert period.unit == "rad"
    assert phase.low <= 1 <= phase.high
    assert law.parameters["size"].value == pytest.approx(0.2, rel=0.1)


def test_a_curve_of_few_numbers_is_no_wave():
    """Of three levels a wave says all, whatever they are."""
    at = np.repeat([0.0, 300.0, 600.0], 2) + np.tile([0.0, 200.0], 3)
    levels = np.repeat([0.2, -0.2, 0.2], 2)
    time = Variable("time_s", "s", at)
    curves = learned(levels)
    for free, wave in ((3, False), (6, True)):
        law = search([time], *curves, channel="intensity", unit="nats", free=free)
        assert ("sin(" in (law.expression if law else "")) == wave


def test_a_product_of_two_covariates_is_found():
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 5), np.linspace(0, 10, 5), indexing="ij"))
    law = law_of(0.05 * x * y, Variable("red_minus_blue", "", x), Variable("speed_mps", "m/s", y))
    assert law.expression == "level + size * red_minus_blue * speed_mps"
    assert law.covariates == ("red_minus_blue", "speed_mps")
    assert law.parameters["size"].value == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize("seed", range(10))
def test_chance_is_no_law(seed):
    assert found(0 * RANGE, Variable("range_m", "m", RANGE), seed=seed) is None


def test_two_values_of_a_covariate_are_no_law():
    two = np.array([0.0, 1.0])
    assert found(np.array([0.0, 0.5]), Variable("row", "", two)) is None
