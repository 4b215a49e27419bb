"""Judge scenes say nothing of effects that are not there."""

import numpy as np
import pytest

from jaxsim.discover.dependences import find_dependences
from jaxsim.discover.read import Comparison, Division
from jaxsim.discover.show import judge
from tests.discover.toy import toy

FRAMES = 12


@pytest.fixture(scope="module")
def shown(standard_promotion):
    scan, measured = toy(FRAMES)
    names = tuple(f"frame {k}" for k in range(FRAMES))
    division = Division.of(Comparison(scan, measured, names, names))
    null = find_dependences(division).null
    return judge(division, null, [], noise=null.noise)


def test_without_an_effect_the_gap_stays_and_there_is_no_closure(shown):
    assert shown.closure is None
    for gap in shown.gap.values():
        assert gap.before == gap.after == gap.placebo
        assert gap.gained.value == 0
    assert shown.curves == ()


def test_maps_before_and_after_are_then_the_same(shown):
    for channel, before in shown.maps_before.items():
        np.testing.assert_array_equal(before, shown.maps_after[channel])
