"""Parts of a verdict."""

import numpy as np
import pytest

from jaxsim.discover.verdict.parts import Interval
from jaxsim.effects import EFFECTS
from jaxsim.metrics.intervals import mean_interval


def test_a_mean_of_scenes_counts_those_that_have_a_value():
    known = np.array([1.0, 2.0, 4.0])
    one = Interval.of_scenes(np.array([1.0, np.nan, 2.0, np.inf, 4.0]), "m")
    assert (one.value, one.unit) == (pytest.approx(7 / 3), "m")
    assert (one.low, one.high) == mean_interval(known)
    assert Interval.of_scenes(known, "m", least=1.5).low == 1.5
    assert np.isnan(Interval.of_scenes(known, "m", fewest=4).value)
    alone = Interval.of_scenes(known[:1], "m")
    assert alone.value == 1.0
    assert np.isnan([alone.low, alone.high]).all()


def test_an_interval_stays_within_the_bounds_of_its_parameter():
    p = EFFECTS["packet_loss"].parameters["probability"]
    bounded = Interval(0.1, -0.2, 2.0, "share of rays").within(p)
    assert (bounded.value, bounded.low, bounded.high, bounded.unit) == (0.1, p.low, p.high, p.unit)
    assert Interval.about(0.5, 0.25, "m") == Interval(0.5, 0.25, 0.75, "m")
    assert Interval.exact(0.5, "m") == Interval.about(0.5, 0.0, "m")
