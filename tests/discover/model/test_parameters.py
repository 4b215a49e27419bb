"""One mapping of parameters to a vector and back, for every effect of the catalogue."""

import numpy as np
import pytest

from jaxsim.discover.model.parameters import fitted_parameters, prior, ravel, restorer, to_values, to_z
from jaxsim.effects import EFFECTS

ROWS = 8


@pytest.mark.parametrize("name", EFFECTS)
def test_values_come_back_through_z_and_through_the_vector(name):
    effect, rng = EFFECTS[name], np.random.default_rng(0)
    given = {
        key: rng.uniform(max(p.low, p.neutral - p.scale), min(p.high, p.neutral + p.scale), p.dims(ROWS))
        for key, p in fitted_parameters(effect).items()
    }
    z = to_z(effect, given, ROWS)
    again = to_values(effect, restorer(z)(ravel(z)))
    assert set(again) == set(effect.parameters)
    for key, p in effect.parameters.items():
        expected = given.get(key, p.neutral)
        np.testing.assert_allclose(again[key], expected, rtol=1e-5, atol=1e-5 * p.scale, err_msg=key)


@pytest.mark.parametrize("name", EFFECTS)
def test_the_bounds_of_z_are_those_of_the_parameters(name):
    effect = EFFECTS[name]
    of_z, back = prior(effect, ROWS), restorer(to_z(effect, {}, ROWS))
    assert (of_z.low <= 0).all()
    assert (of_z.high >= 0).all()
    for side, bound in (("low", of_z.low), ("high", of_z.high)):
        values = to_values(effect, back(bound))
        for key, p in fitted_parameters(effect).items():
            np.testing.assert_allclose(values[key], getattr(p, side), rtol=1e-4, atol=1e-4 * p.scale, err_msg=key)


def test_beams_are_held_closer_than_single_numbers():
    gains, falloff = prior(EFFECTS["beam_gain"], ROWS), prior(EFFECTS["range_falloff"], ROWS)
    assert gains.sd.tolist() == [1.0] * ROWS
    assert set(falloff.sd) == {3.0}


def test_a_vector_has_double_precision_and_a_tree_single():
    z = to_z(EFFECTS["range_falloff"], {}, ROWS)
    back = restorer(z)(ravel(z) + 1 / 3)
    assert all(value.dtype == np.float32 for value in back.values())
    np.testing.assert_array_equal(ravel(back), (ravel(z) + 1 / 3).astype(np.float32))
    assert ravel({}).shape == (0,)
    precise = to_z(EFFECTS["range_falloff"], {}, ROWS, dtype=np.float64)
    assert all(value.dtype == np.float64 for value in precise.values())


def test_of_sparse_numbers_a_few_far_off_cost_less_than_many_that_are_a_little_off():
    beams, gains = prior(EFFECTS["beam_dropout"], ROWS), prior(EFFECTS["beam_gain"], ROWS)
    few, many = np.eye(ROWS)[3], np.full(ROWS, ROWS**-0.5)
    assert beams.cost(few)[0] < beams.cost(many)[0] / 4
    assert gains.cost(few)[0] == pytest.approx(gains.cost(many)[0])


@pytest.mark.parametrize("name", ["beam_dropout", "beam_gain", "range_falloff"])
def test_the_prior_s_derivatives_are_those_of_its_cost(name):
    effect = EFFECTS[name]
    of_z = prior(effect, ROWS)
    at = np.random.default_rng(1).uniform(0, 1, len(of_z.sd))
    for k in range(len(at)):
        step = 1e-6 * np.eye(len(at))[k]
        slope = (of_z.cost(at + step)[0] - of_z.cost(at - step)[0]) / 2e-6
        assert of_z.cost(at)[1][k] == pytest.approx(slope, rel=1e-4)
