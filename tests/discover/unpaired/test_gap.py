"""The gap and its closure, of distances of judge scenes."""

import numpy as np
import pytest

from jaxsim.discover.unpaired.gap import _closure, _gap

BEFORE = np.array([1.0, 1.1, 0.9, 1.0])
FLOOR = BEFORE - np.array([0.5, 0.55, 0.45, 0.5])


def test_an_answer_that_reaches_the_floor_closes_the_gap():
    gap = _gap(BEFORE, FLOOR, floor=FLOOR, placebo=BEFORE)
    assert (gap.before, gap.after, gap.floor, gap.placebo) == pytest.approx((1.0, 0.5, 0.5, 1.0))
    assert gap.win_rate == 1
    assert gap.low > 0
    assert _closure(BEFORE, FLOOR, floor=FLOOR).value == pytest.approx(1)


def test_there_is_no_closure_where_free_curves_explain_nothing():
    assert _closure(BEFORE, BEFORE, floor=BEFORE + np.array([0.1, -0.1, 0.1, -0.1])) is None
