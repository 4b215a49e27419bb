"""The law as linear algebra: equal to what it stands for, written out."""

import numpy as np
import pytest

from jaxsim.discover.unpaired.columns import curve
from jaxsim.discover.unpaired.equations import (
    Block,
    RandomEffects,
    equations,
    exchanged,
    freedom,
    lowered,
    solve,
    without_random,
)


def model(n=600, scenes=6, seed=0):
    """A law, one column of the measured side, levels of patches: y with a side effect of 0.5."""
    rng = np.random.default_rng(seed)
    x, scene = rng.uniform(0, 1, n), np.arange(n) % scenes
    law, side = curve(x, 5).astype(float), rng.normal(0, 1, (n, 1))
    sensed, patch = np.arange(scenes) % 2 == 1, scene * 10 + rng.integers(0, 10, n)
    y = np.sin(3 * x) + 0.5 * side[:, 0] * sensed[scene] + rng.normal(0, 0.2, 60)[patch] + rng.normal(0, 0.1, n)
    return law, side, scene, sensed, patch, y


def test_equations_are_generalised_least_squares():
    law, side, scene, sensed, patch, y = model()
    random = RandomEffects(np.ones((len(y), 1)), np.array([0.3]), patch, 0.2)
    eq = equations(y, law, side, random=random, scene=scene, scenes=6, variance=0.01)
    solution = solve(eq.pooled(np.ones(6), sensed.astype(float)), [Block(np.array([0]), np.array([1e-9]))])
    # The same with the covariance of all rays written out.
    cov = 0.01 * np.eye(len(y)) + 0.3**2 * (scene[:, None] == scene) + 0.2**2 * (patch[:, None] == patch)
    x = np.concatenate([law, side * sensed[scene][:, None]], axis=1)
    a = x.T @ np.linalg.solve(cov, x) + np.diag([1.0] * law.shape[1] + [1e-9])
    expected = np.linalg.solve(a, x.T @ np.linalg.solve(cov, y))
    np.testing.assert_allclose([*solution.law, *solution.side], expected, rtol=1e-6)


def test_what_is_left_of_residuals_is_what_the_covariance_of_scenes_leaves():
    _, side, scene, _, patch, y = model()
    slopes = np.concatenate([np.ones((len(y), 1)), side], axis=1)
    random = RandomEffects(slopes, np.array([0.3, 0.1]), patch, 0.2)
    same = scene[:, None] == scene
    cov = 0.2**2 * (patch[:, None] == patch) + same * (slopes * [0.3**2, 0.1**2] @ slopes.T)
    # Of readings with covariance cov + noise, what the noise has of them.
    expected = 0.01 * np.linalg.solve(cov + 0.01 * np.eye(len(y)), y)
    np.testing.assert_allclose(without_random(y, random, scene=scene, variance=0.01), expected, atol=1e-9)


def test_exchanged_scenes_lower_the_loss_less_than_the_true_ones():
    law, side, scene, sensed, patch, y = model()
    both = np.concatenate([np.ones((len(y), 1)), side], axis=1)
    random = RandomEffects(np.ones((len(y), 1)), np.array([0.3]), patch, 0.2)
    eq = equations(y, law, both, random=random, scene=scene, scenes=6, variance=0.01)
    gain = Block(np.array([0]), np.array([1e-3]))
    block = Block(np.array([1]), np.array([1e-3]))
    drops = lowered(eq, exchanged(sensed, 20), [block], weight=np.ones(6), nuisance=gain)[:, 0]
    assert drops[0] > 2 * np.median(drops)


def test_a_block_held_firmly_is_less_free():
    law, side, scene, sensed, patch, y = model()
    random = RandomEffects(np.ones((len(y), 1)), np.array([0.3]), patch, 0.2)
    eq = equations(y, law, side, random=random, scene=scene, scenes=6, variance=0.01)
    free, held = [
        freedom(eq, Block(np.array([0]), np.array([p])), weight=np.ones(6), measured=sensed.astype(float))
        for p in (1e-6, 1e9)
    ]
    assert free == pytest.approx(1, abs=1e-3)
    assert held < 0.01


def test_the_first_exchange_is_the_true_one_and_all_have_as_many_measured_scenes():
    sensed = np.array([True, False, True, False, False])
    for count in (7, 10, 30):
        draws = exchanged(sensed, count)
        np.testing.assert_array_equal(draws[0], sensed)
        assert (draws.sum(1) == 2).all()
        assert not (draws[1:] == sensed).all(1).any()
        # There are ten ways to choose two of five.
        assert len(draws) == min(count, 10)
    assert len(np.unique(draws, axis=0)) == 10
