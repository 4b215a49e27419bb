"""Effects with a number for each beam, and the same with these numbers made smooth along the rows.

A laser's gain, bias or elevation is its own affair: neighbours in the table need not agree. What the rows see
(road below, walls and windows above) changes smoothly from row to row, and a simulator's wrong materials look like
smooth gains.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.fit import Fit, Problem, score_at
from jaxsim.discover.model.parameters import fitted_parameters
from jaxsim.effects import Effect

REACH = 3
"""Rows to each side over which a line is fitted."""


def by_beam(effect: Effect) -> bool:
    """Whether the effect has a number for each beam."""
    return any(p.shape == "row" for p in fitted_parameters(effect).values())


def smooth(numbers: Float[np.ndarray, " r"]) -> Float[np.ndarray, " r"]:
    """Each number replaced by the line through it and its neighbours, REACH to each side, by least squares."""
    rows = np.arange(len(numbers))
    result = np.empty(len(numbers))
    for k in rows:
        near = slice(max(k - REACH, 0), k + REACH + 1)
        away = rows[near] - k
        result[k] = np.polyfit(away, numbers[near], min(1, len(away) - 1))[-1]
    return result


def smooth_score(
    effect: Effect, problem: Problem, fitted: Float[np.ndarray, " b"], found: Fit
) -> Float[np.ndarray, "b 3"]:
    """Log-likelihood of every block by channel with the beams' numbers of a fit made smooth."""
    kinds = fitted_parameters(effect)
    z = {name: smooth(value) if kinds[name].shape == "row" else value for name, value in found.z.items()}
    return score_at(effect, problem, fitted, z={n: np.asarray(v, np.float32) for n, v in z.items()}, noise=found.noise)
