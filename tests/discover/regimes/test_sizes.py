"""How large an effect is in a part, from slopes of the likelihood at a few shares of it."""

import numpy as np
import pytest

from jaxsim.discover.regimes.sizes import SIZE_ENDS, SIZE_SHARES, least_size, share_of, size_of, sizes_at
from jaxsim.effects import EFFECTS

RAYS = 1000
BASE, LOST = 0.001, 0.1
"""Share of returns that are lost anyway, and that the effect loses."""


def slopes_of_losses(lost: int) -> np.ndarray:
    """Of d/dk [n ln(b + k p) + (N - n) ln(1 - b - k p)]."""
    chance = BASE + SIZE_SHARES * LOST
    return lost * LOST / chance - (RAYS - lost) * LOST / (1 - chance)


def test_of_a_parabola_the_size_is_that_of_its_top():
    tops = np.array([-0.4, 0.0, 0.03, 0.6, 1.0, 1.7])
    np.testing.assert_allclose(share_of(50 * (tops - SIZE_SHARES[:, None])), tops, atol=1e-12)


@pytest.mark.parametrize("lost", [1, 2, 5, 30, 60, 100])
def test_of_losses_it_is_that_of_the_most_likely_share(lost):
    """A line from none to all of it would give 0.5 for the two of a thousand that are lost where one is by itself."""
    exact = (lost / RAYS - BASE) / LOST
    assert share_of(slopes_of_losses(lost)[:, None])[0] == pytest.approx(exact, abs=0.06)


def test_a_likelihood_that_bends_upward_asks_for_the_most_or_the_least():
    slopes = np.array([1.0, -1.0])[None] + np.array([1.0, 1.0])[None] * SIZE_SHARES[:, None] * [1.0, -1.0]
    assert share_of(slopes).tolist() == [SIZE_ENDS[1], SIZE_ENDS[0]]


def test_a_part_that_lost_nothing_is_not_told_to_have_lost_many_times_less_than_nothing():
    assert share_of(slopes_of_losses(0)[:, None])[0] == -1


def test_parts_that_lost_nothing_at_all_say_for_certain_that_the_effect_is_not_there():
    """Their likelihood is a line that falls from none on; scenes of the other side have no slope."""
    nothing = -np.full((len(SIZE_SHARES), 4), LOST * RAYS) - SIZE_SHARES[:, None]
    of_scenes = np.hstack([nothing, np.zeros((len(SIZE_SHARES), 3))])
    size = size_of(of_scenes, least_size(EFFECTS["random_dropout"]))
    assert (size.value, size.low, size.high) == (0, 0, 0)
    # A gain may be the opposite elsewhere.
    assert least_size(EFFECTS["beam_gain"]) < 0


def test_scenes_that_lose_next_to_nothing_say_for_certain_that_they_lose_nothing_at_random():
    of_scenes = np.stack([slopes_of_losses(lost) for lost in (0, 3, 1, 0, 2)], axis=1)
    size = size_of(of_scenes)
    assert size.value == pytest.approx(0, abs=0.01)
    assert -0.1 < size.low < 0 < size.high < 0.1


def test_every_place_has_its_own_size_and_those_that_tell_none_have_none():
    slopes = np.stack([[50 * (0.0 - s), 40 * (1.0 - s), 0 * s] for s in SIZE_SHARES])[:, None]
    size = sizes_at(slopes, np.array([[0, 1, 2]]), 3)
    np.testing.assert_allclose(size, [0, 1, np.nan], atol=1e-12)
