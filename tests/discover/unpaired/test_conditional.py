"""What the comparison is made of: kinds of surface, patches, common classes, clipping."""

import numpy as np

from jaxsim.discover.rules import RULES
from jaxsim.discover.unpaired.conditional import _clipped, _common, _inflation, _within
from jaxsim.discover.unpaired.equations import Block, RandomEffects, equations, exchanged


def test_a_rare_class_has_no_level_of_its_own():
    np.testing.assert_array_equal(_common(np.repeat([7, 11, 26], [500, 496, 4])), [7, 11])


def test_readings_are_held_within_reach_of_their_own_side():
    rng = np.random.default_rng(0)
    y = rng.normal(0, 0.1, 1000)
    y[:2] = [5.0, -5.0]
    sensed = np.arange(1000) < 500
    held = _clipped(y, np.ones((1000, 1)), np.ones(1000, bool), sensed=sensed)
    assert np.abs(held).max() < 1.2 * RULES.unpaired_held_sd * 0.1
    np.testing.assert_allclose(held[2:500], y[2:500], atol=0.1)


def test_the_noise_is_what_scatters_within_a_patch():
    rng = np.random.default_rng(0)
    patch = np.arange(4000) % 500
    off = rng.normal(0, 1, 500)[patch] + rng.normal(0, 0.1, 4000)
    assert abs(_within(off, patch, np.ones(4000, bool)) - 0.01) < 0.001


def test_where_no_block_says_anything_of_the_noise_it_is_not_inflated():
    rng = np.random.default_rng(0)
    n, scenes = 300, 6
    scene = np.arange(n) % scenes
    random = RandomEffects(np.ones((n, 1)), np.array([0.3]), scene, 0.2)
    side = rng.normal(0, 1, (n, 2))
    eq = equations(rng.normal(0, 1, n), np.ones((n, 1)), side, random=random, scene=scene, scenes=scenes, variance=1.0)
    draws = exchanged(np.arange(scenes) % 2 == 1, 20)
    nuisance, held = Block(np.array([0]), np.array([1.0])), Block(np.array([1]), np.array([1e9]))
    for blocks in ([], [held]):
        assert _inflation(eq, np.ones(scenes), draws, nuisance=nuisance, blocks=blocks) == 1
