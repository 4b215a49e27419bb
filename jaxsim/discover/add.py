"""The named effects fitted together, as they enter the sensor model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxsim.discover.fit import Problem, fit, on_top
from jaxsim.discover.lattice import FINEST
from jaxsim.discover.null import fit_null
from jaxsim.discover.parameters import to_values
from jaxsim.effects import EFFECTS, Effect


def in_place(null: Problem, effects: Sequence[tuple[Effect, dict[str, Any]]], *, simulated: bool = False) -> Problem:
    """The null with these effects (their z) on top, in physical order; its nuisances are not refitted."""
    problem = null
    for effect, z in sorted(effects, key=lambda pair: list(EFFECTS).index(pair[0].name)):
        problem = on_top(effect, problem, z, simulated=simulated)
    return problem


def refit(
    null: Problem, effects: Sequence[Effect], z: Sequence[dict[str, Any]], everyone: np.ndarray, *, sweeps: int = 2
) -> list[tuple[Effect, Problem, Any]]:
    """Each effect fitted with all others in place: the effect, the problem that it was fitted in, the fit. The
    nuisances of `null` are fitted; they are again beside other effects."""
    values, result = dict(enumerate(z)), {}
    for _ in range(sweeps if len(effects) > 1 else 1):
        for k in range(len(effects)):
            others = [(effects[j], values[j]) for j in range(len(effects)) if j != k]
            problem = in_place(null, others)
            if others:
                problem, _ = fit_null(problem.scan, problem.ev, everyone, clutter=problem.clutter)
            # Values that are read off the data (steps of rounding) stay.
            start = ({n: np.asarray(v) for n, v in to_values(effects[k], values[k]).items()},)
            found = fit(effects[k], problem, everyone, starts=start, steps=80, fixed=effects[k].name in FINEST)
            values[k] = found.z
            result[k] = (effects[k], problem, found)
    return [result[k] for k in range(len(effects))]


def parameters_of(effect: Effect, z: dict[str, Any]) -> dict[str, Any]:
    """Parameters as sensor.json holds them, within their bounds."""
    values = {}
    for name, p in effect.parameters.items():
        value = np.clip(np.asarray(to_values(effect, z)[name], float), p.low, p.high)
        values[name] = float(value) if value.ndim == 0 else tuple(value.tolist())
    return values
