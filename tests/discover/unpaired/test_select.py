"""Which candidate is accepted, who is its look-alike, and when a free curve says that none is the answer."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxsim.discover.name.select import Step
from jaxsim.discover.unpaired import select
from jaxsim.discover.unpaired.law import Block, RandomEffects, equations
from jaxsim.discover.unpaired.select import UnpairedChoice, _alike, _folds, held_out, held_out_losses
from jaxsim.discover.unpaired.workflow import curve_covariates
from jaxsim.discover.verdict import Unexplained
from tests.discover.unpaired.made import candidate


def test_both_tests_must_be_passed():
    assert candidate("beam_gain", 3.0).accepted
    assert not candidate("beam_gain", 3.0, chance=0.02).accepted
    assert not candidate("beam_gain", -0.5).accepted


def test_a_look_alike_need_not_be_accepted_but_gains_about_as_much():
    best = candidate("beam_gain", 3.0)
    assert _alike(candidate("range_falloff", 3.0, chance=0.04), best)
    assert not _alike(candidate("range_falloff", 3.0, chance=0.06), best)
    assert not _alike(candidate("range_falloff", 1.0), best)
    assert not _alike(candidate("range_falloff", 2.5), best)  # every scene says less


def test_scenes_of_either_side_are_dealt_to_the_folds_in_turn():
    measured = np.array([True, True, False, True, False, True, True])
    np.testing.assert_array_equal(_folds(measured), [0, 1, 0, 2, 1, 3, 0])


def curve(name: str, gain: float):
    made = candidate("beam_gain", gain)
    return replace(made, term=replace(made.term, name=name))


def test_a_curve_must_gain_clearly_more_than_the_best_effect(monkeypatch):
    monkeypatch.setattr(select, "_described", lambda problem, one: Unexplained("intensity", one.name, "other", ""))
    best = candidate("beam_gain", 3.0)
    choice = UnpairedChoice((Step(best, (), (best,)),), ())
    problem = object.__new__(select.Conditional)
    assert select.outside_catalogue(problem, choice, [curve("range", 5.5)], fitted=1.0).covariate == "range"
    assert select.outside_catalogue(problem, choice, [curve("range", 4.0)], fitted=1.0) is None
    assert select.outside_catalogue(problem, choice, [curve("range", 5.5)], fitted=50.0) is None


def test_a_curve_along_the_rows_is_an_effect_of_the_catalogue(monkeypatch):
    monkeypatch.setattr(select, "_described", lambda problem, one: Unexplained("intensity", one.name, "other", ""))
    problem = object.__new__(select.Conditional)
    assert select.outside_catalogue(problem, UnpairedChoice((), ()), [curve("row", 9.0)], fitted=0.0) is None


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
    problem: Any = object.__new__(select.Conditional)
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
