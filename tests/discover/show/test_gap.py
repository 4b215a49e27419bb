"""Before against after, scene by scene; and the floor: a black box of the right covariate reaches the noise."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy import stats

from jaxsim.discover.model.likelihood import DEGREES
from jaxsim.discover.model.null_model import residuals
from jaxsim.discover.show.gap import Distance, additive_floor, closure, distance, gaps, log_odds, robust
from jaxsim.effects.effect import CHANNELS
from tests.discover.toy import judged_toy

NOTHING = np.zeros((5, 3))


def at(error: np.ndarray | float = 0.2, log_likelihood: np.ndarray = NOTHING) -> Distance:
    return Distance(np.broadcast_to(error, (5, 3)), log_likelihood)


def by_channel(*nats: float) -> np.ndarray:
    return np.tile(np.array(nats, float), (5, 1))


def test_closure_is_the_share_of_what_free_curves_gain():
    before, floor = at(), at(0.1, by_channel(100, 0, 0))
    after = at(0.12, by_channel(80, -500, 0))
    found = closure(before, after, floor=floor, channels=["intensity"])
    np.testing.assert_allclose(found.value, 0.8)
    gap = gaps(before, after, placebo=before, floor=floor)["intensity"]
    np.testing.assert_allclose([gap.before, gap.after, gap.floor, gap.win_rate], [0.2, 0.12, 0.1, 1])
    np.testing.assert_allclose([gap.gained.value, gap.gained.floor, gap.gained.placebo], [80, 100, 0])


def test_a_floor_that_lies_above_what_the_effects_reach_is_given_as_it_is():
    noise = np.random.default_rng(1).normal(0, 2, (5, 3))
    before, after = at(), at(0.1, 100 + noise)
    found = closure(before, after, floor=at(0.12, 80 + noise[::-1]), channels=["intensity"])
    assert 1 < found.low < found.value < found.high
    assert closure(before, after, floor=at(0.2, 20 * noise), channels=["intensity"]) is None
    assert closure(before, after, floor=at(0.2, 80 + noise), channels=[]) is None


@pytest.mark.parametrize("grown", [0.0, 0.03])
def test_a_channel_is_not_worse_only_where_the_scenes_show_it(grown):
    before = np.full((5, 3), 0.2)
    after = before * (1 + grown) + np.array([-1, 0, 1, 0, 0])[:, None] * 1e-4
    assert gaps(at(before), at(after), placebo=at(), floor=at())["drop"].not_worse is (grown == 0)
    unsure = before + np.array([-1, 0, 1, 0, 0])[:, None] * 0.02
    assert not gaps(at(before), at(unsure), placebo=at(), floor=at())["drop"].not_worse


def test_a_likelihood_that_some_scenes_lose_is_no_certain_gain():
    spread = NOTHING + np.array([30.0, -20, 25, -15, 10])[:, None]
    gained = gaps(at(), at(0.2, spread), placebo=at(), floor=at())["range"].gained
    assert gained.low < 0 < gained.high
    assert gained.win_rate == 0.6


def test_scenes_that_are_not_compared_are_neither_won_nor_lost():
    before = np.full((5, 3), 0.2)
    before[3:] = np.nan
    found = gaps(at(before), at(before / 2), placebo=at(before), floor=at(before))["intensity"]
    assert found.win_rate == 1.0


@pytest.fixture(scope="module")
def judged(standard_promotion):
    return judged_toy()


def test_errors_are_those_of_the_residuals_and_likelihoods_those_of_their_law(judged):
    found, in_fit, scene = judged
    told = distance(found, in_fit, found.equations, scene=scene)
    # The toy's sensor has range noise of 2 cm and loses one ray in a hundred.
    np.testing.assert_allclose(told.error[:, 1].mean(), 0.02 * np.sqrt(2 / np.pi), rtol=0.1)
    rays = 30 * 16
    law = stats.t(DEGREES, scale=0.86 * 0.02)
    expected = rays * law.logpdf(np.random.default_rng(0).normal(0, 0.02, 100_000)).mean()
    np.testing.assert_allclose(told.log_likelihood[:, 1].mean(), expected, rtol=0.1)
    lost = np.asarray(~found.ev.returned)[scene >= 6].sum((1, 2))
    np.testing.assert_allclose(told.log_likelihood[:, 2], lost * np.log(0.01) + (rays - lost) * np.log(0.99), rtol=0.2)


def test_noise_of_the_right_size_gains_and_errors_stay(judged):
    found, in_fit, scene = judged
    loud = replace(found, noise=replace(found.noise, range_=found.noise.range_ + 0.7))
    right = distance(found, in_fit, found.equations, scene=scene)
    wrong = distance(loud, in_fit, found.equations, scene=scene)
    assert (right.log_likelihood - wrong.log_likelihood)[:, 1].min() > 20
    np.testing.assert_array_equal(right.error[:, 1], wrong.error[:, 1])


@pytest.fixture(scope="module")
def both():
    found, in_fit, scene = judged_toy(gain=0.3)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        free = replace(found, ev=additive_floor(found, in_fit, ["row"]).on(found.ev))
        assert list(residuals(found, in_fit)) == list(CHANNELS)
        return [distance(problem, in_fit, found.equations, scene=scene) for problem in (found, free)]


def test_along_the_rows_it_takes_beam_gains_and_leaves_ranges(both):
    before, floor = [one.error.mean(0) for one in both]
    assert floor[0] < 0.5 * before[0]
    np.testing.assert_allclose(floor[1], before[1], rtol=0.2)


def test_losses_along_a_covariate_are_taken_too():
    found, in_fit, scene = judged_toy()
    ev = found.ev
    gone = (ev.rays.row == 9) & (np.random.default_rng(2).random(ev.returned.shape) < 0.5)
    found = replace(found, ev=ev.replace(returned=ev.returned & ~gone))
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        free = replace(found, ev=additive_floor(found, in_fit, ["row"]).on(found.ev))
        before, floor = [distance(one, in_fit, found.equations, scene=scene) for one in (found, free)]
    assert (floor.log_likelihood - before.log_likelihood)[:, 2].min() > 20
    assert floor.error[:, 2].mean() < 0.7 * before.error[:, 2].mean()


def test_the_likelihood_of_every_scene_gains_by_it(both):
    gained = both[1].log_likelihood - both[0].log_likelihood
    assert (gained[:, 0] > 50).all()
    assert (np.abs(gained[:, 1:]) < 10).all()


def one_hot(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.eye(3)[rng.integers(0, 3, n)]


def test_far_readings_do_not_bend_the_curves():
    rng = np.random.default_rng(0)
    x, truth = one_hot(rng, 6000), np.array([0.05, -0.03, 0.0])
    y = x @ truth + rng.normal(0, 0.01, 6000) + np.where(rng.random(6000) < 0.1, rng.uniform(0, 50, 6000), 0)
    np.testing.assert_allclose(robust(x, y, np.full(6000, 0.01)), truth, atol=2e-3)


def test_curves_of_losses_are_the_log_odds_that_are_missing():
    rng = np.random.default_rng(1)
    x, more = one_hot(rng, 60_000), np.array([0.0, 1.5, -1.0])
    p = rng.uniform(0.01, 0.3, 60_000)
    odds = p / (1 - p) * np.exp(x @ more)
    lost = rng.random(60_000) < odds / (1 + odds)
    np.testing.assert_allclose(log_odds(x, lost - p, p), more, atol=0.1)
