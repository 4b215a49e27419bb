"""Effects as columns: which can be told, and that a column is the change that its parameter makes."""

import numpy as np

from jaxsim.discover.unpaired.effect_columns import columns_of, derivatives, untold
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
