"""Columns: which effects can be told, and that one is the change that its parameter makes; bases of curves."""

import numpy as np

from jaxsim.discover.find.covariates import products
from jaxsim.discover.unpaired.columns import columns_of, curve, derivatives, one_hot, untold
from jaxsim.effects import EFFECTS


def test_every_effect_is_told_or_listed_as_untold():
    assert "extrinsic_rotation" in untold(classes=False)
    assert set(untold(classes=True)) < set(untold(classes=False))
    assert "gamma_response" in untold(classes=False)


def test_a_derivative_is_the_change_by_one_scale():
    effect = EFFECTS["range_falloff"]
    name, p = next(iter(effect.parameters.items()))
    x = np.linspace(-1, 1, 5)
    columns = derivatives(effect, {}, lambda values: x * values.get(name, p.neutral), row=np.zeros(5, int), rows=1)
    np.testing.assert_allclose(columns.columns[:, 0], x * p.scale, rtol=1e-5)


def test_each_start_has_a_column_of_its_own_that_must_be_positive():
    effect = EFFECTS["window_contamination"]
    starts = columns_of(effect, lambda values: np.ones(4), np.zeros(4, int), rows=2)
    assert len(starts) == len(effect.starts)
    assert all(one.sign == 1 and one.columns[0, 0] == 1 for one in starts)


def test_hat_functions_sum_to_one_and_draw_lines():
    x = np.random.default_rng(0).uniform(0, 1, 500)
    basis = curve(x, 5, low=0.0, high=1.0)
    np.testing.assert_allclose(basis.sum(1), 1, atol=1e-6)
    knots = np.quantile(x, np.linspace(0, 1, 5))
    np.testing.assert_allclose(basis @ knots, x, atol=1e-6)
    assert curve(np.ones(4), 5).shape == (4, 1)


def test_a_curve_for_each_part():
    parts = one_hot(np.array([0, 1, 1]))
    columns = products(parts, np.array([[2.0, 3.0], [4.0, 5.0], [6.0, 7.0]]))
    np.testing.assert_array_equal(columns, [[2, 3, 0, 0], [0, 0, 4, 5], [0, 0, 6, 7]])
