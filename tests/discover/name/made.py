"""Candidates, steps and problems made by hand, for tests of decisions alone."""

from dataclasses import replace
from typing import Any

import numpy as np

from jaxsim.discover.model.fit import Fit, Problem
from jaxsim.discover.model.noise import START
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.other_sides import OtherSides
from jaxsim.discover.name.select import FittedStep
from jaxsim.effects import EFFECTS

CHANNEL = {"intensity": 0, "range": 1, "drop": 2}
NOTHING = np.zeros((1, 3), np.float32)


def fitted(numbers: int = 3) -> Fit:
    """A fit of so many numbers."""
    return Fit({"x": np.zeros(numbers)}, START, NOTHING, 0.0)


def candidate(name: str, each, channel: str = "intensity", *, slope=None, scenes: int = 11, numbers: int = 3):
    """A candidate of these gains, one for each scene or the same for all; an unknown name is a free curve's."""
    gain = np.zeros((scenes, 3))
    gain[:, CHANNEL[channel]] = each
    effect = EFFECTS.get(name) or replace(EFFECTS["beam_gain"], name=name, channels=(channel,))
    slope = gain.sum(1) / 4 if slope is None else np.asarray(slope, float)
    return Candidate(effect, gain, (fitted(numbers),), slope)


def step(chosen: Candidate, *alike: Candidate, ranking=()) -> FittedStep:
    return FittedStep(chosen, alike, tuple(ranking), fitted())


def problem(**fields: Any) -> Problem:
    """A problem that has these fields alone."""
    bare = object.__new__(Problem)
    for name, value in fields.items():
        object.__setattr__(bare, name, value)
    return bare


def showing(*, why: str, all_curves: bool = False, effects: bool = False) -> OtherSides:
    """Other sides, which show every curve, or every effect, or none."""

    class Sides(OtherSides):
        def has_curve(self, fitted_to, along, curve):
            return all_curves

        def has(self, step, there):
            return effects

    sides = object.__new__(Sides)
    object.__setattr__(sides, "why", why)
    return sides
