"""A black box of the right covariate reaches the noise, in errors and in likelihood, and touches no other channel."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxsim.discover.model.likelihood import CHANNELS
from jaxsim.discover.model.residuals import residuals
from jaxsim.discover.show.additive_floor import black_box, log_odds, robust
from jaxsim.discover.show.distance import distance
from tests.discover.conftest import judged_toy


@pytest.fixture(scope="module")
def both():
    found, fitted, unit = judged_toy(gain=0.3)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        free = replace(found, ev=black_box(found, fitted, ["row"]).on(found.ev))
        assert list(residuals(found, fitted)) == list(CHANNELS)
        return [distance(problem, fitted, found.equations, unit) for problem in (found, free)]


def test_along_the_rows_it_takes_beam_gains_and_leaves_ranges(both):
    before, floor = (one.error.mean(0) for one in both)
    assert floor[0] < 0.5 * before[0]
    np.testing.assert_allclose(floor[1], before[1], rtol=0.2)


def test_losses_along_a_covariate_are_taken_too():
    found, fitted, unit = judged_toy()
    ev = found.ev
    gone = (ev.rays.row == 9) & (np.random.default_rng(2).random(ev.returned.shape) < 0.5)
    found = replace(found, ev=ev.replace(returned=ev.returned & ~gone))
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        free = replace(found, ev=black_box(found, fitted, ["row"]).on(found.ev))
        before, floor = (distance(problem, fitted, found.equations, unit) for problem in (found, free))
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
