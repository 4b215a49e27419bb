"""Before against after, scene by scene."""

import numpy as np
import pytest

from jaxsim.discover.show.distance import Distance
from jaxsim.discover.show.gap import closure, gaps

NOTHING = np.zeros((5, 3))


def at(error: np.ndarray | float = 0.2, log_likelihood: np.ndarray = NOTHING) -> Distance:
    return Distance(np.broadcast_to(error, (5, 3)), log_likelihood)


def by_channel(*nats: float) -> np.ndarray:
    return np.tile(nats, (5, 1))


def test_closure_is_the_share_of_what_free_curves_gain():
    before, floor = at(), at(0.1, by_channel(100, 0, 0))
    after = at(0.12, by_channel(80, -500, 0))
    found = closure(before, after, floor, ["intensity"])
    np.testing.assert_allclose(found.value, 0.8)
    gap = gaps(before, after, before, floor)["intensity"]
    np.testing.assert_allclose([gap.before, gap.after, gap.floor, gap.win_rate], [0.2, 0.12, 0.1, 1])
    np.testing.assert_allclose([gap.gained.value, gap.gained.floor, gap.gained.placebo], [80, 100, 0])


def test_a_floor_that_lies_above_what_the_effects_reach_is_given_as_it_is():
    noise = np.random.default_rng(1).normal(0, 2, (5, 3))
    before, after = at(), at(0.1, 100 + noise)
    found = closure(before, after, at(0.12, 80 + noise[::-1]), ["intensity"])
    assert 1 < found.low < found.value < found.high
    assert closure(before, after, at(0.2, 20 * noise), ["intensity"]) is None
    assert closure(before, after, at(0.2, 80 + noise), []) is None


@pytest.mark.parametrize("grown", [0.0, 0.03])
def test_a_channel_is_not_worse_only_where_the_scenes_show_it(grown):
    before = np.full((5, 3), 0.2)
    after = before * (1 + grown) + np.array([-1, 0, 1, 0, 0])[:, None] * 1e-4
    assert gaps(at(before), at(after), at(), at())["drop"].not_worse is (grown == 0)
    unsure = before + np.array([-1, 0, 1, 0, 0])[:, None] * 0.02
    assert not gaps(at(before), at(unsure), at(), at())["drop"].not_worse


def test_a_likelihood_that_some_scenes_lose_is_no_certain_gain():
    spread = NOTHING + np.array([30, -20, 25, -15, 10])[:, None]
    gained = gaps(at(), at(0.2, spread), at(), at())["range"].gained
    assert gained.low < 0 < gained.high
    assert gained.win_rate == 0.6
