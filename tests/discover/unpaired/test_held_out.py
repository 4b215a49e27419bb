"""What a term gains on scenes that its fit has not seen, and how scenes are held out."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxsim.discover.unpaired.conditional import Conditional
from jaxsim.discover.unpaired.equations import Block, RandomEffects, equations
from jaxsim.discover.unpaired.held_out import _folds, held_out, held_out_losses
from jaxsim.discover.unpaired.workflow import curve_covariates
from tests.discover.unpaired.made import candidate


def test_scenes_of_either_side_are_dealt_to_the_folds_for_themselves():
    measured = np.array([True, True, False, True, False, True, True, True, False, True, True])
    fold = _folds(measured)
    # Eight of one side are two for each of four folds, three of the other one for each of three.
    np.testing.assert_array_equal(np.bincount(fold[measured]), [2, 2, 2, 2])
    np.testing.assert_array_equal(np.sort(fold[~measured]), [0, 1, 2])


def test_the_share_of_a_covariate_is_that_of_held_out_squares():
    """A wave as high as the noise, on the measured side alone: a half of its squares there, a third of all."""
    rng = np.random.default_rng(0)
    scenes, n = 16, 8000
    scene = np.arange(n) % scenes
    wave = np.sign(rng.normal(size=n))
    y = 3 + rng.normal(0, 1, n) + wave * (scene % 2)
    random = RandomEffects(np.zeros((n, 1)), np.array([1e-6]), scene, 1e-6)
    side = np.column_stack([np.ones(n), wave])
    eq = equations(y, np.ones((n, 1)), side, random=random, scene=scene, scenes=scenes, variance=1.0)
    measured = np.arange(scenes) % 2 == 1
    problem: Any = object.__new__(Conditional)
    nuisance = Block(np.array([0]), np.array([1e-3]))
    curve = Block(np.array([1]), np.array([1e-3]))
    for name, value in {
        "comparison": SimpleNamespace(measured=measured),
        "equations": eq,
        "nuisance": nuisance,
        "find": np.arange(scenes) < 12,
    }.items():
        object.__setattr__(problem, name, value)
    gain = held_out(problem, nuisance, [curve])[0]
    found = replace(candidate("beam_gain", 0.0, chance=0.01), by_scene=gain)
    (where,) = curve_covariates(problem, [found])
    assert where.share == pytest.approx(1 / 3, abs=0.02)
    # The level of all readings is no residual.
    assert held_out_losses(problem, nuisance).sum() == pytest.approx(0.5 * (n * 12 / 16) * 1.5, rel=0.03)
