"""Several effects at once: in place on the rays, and each fitted with all others in place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxsim.discover.model.fit import Chain, Fit, Problem, all_on_top, fit
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.model.parameters import to_values
from jaxsim.effects import EFFECTS, Law

SWEEPS = 2
"""Passes over several effects, each fitted beside the others."""


@dataclass(frozen=True)
class Refit:
    """An effect fitted with all others in place."""

    effect: Law
    problem: Problem
    """The problem in which it was fitted."""
    fit: Fit


def in_place(null: Problem, effects: Chain, *, simulated: bool = False) -> Problem:
    """The null with these effects on top, in physical order, learned laws last; its nuisances are not refitted."""
    # Effects do not commute (a ceiling cuts what a gain has raised): the catalogue's order is that of the light's way.
    order = {name: k for k, name in enumerate(EFFECTS)}
    physical = sorted(effects, key=lambda pair: order.get(pair[0].plain_name, len(order)))
    return all_on_top(physical, null, simulated=simulated)


def refit(null: Problem, effects: Sequence[Law], z: Sequence[dict[str, Any]]) -> tuple[Refit, ...]:
    """Each effect fitted with all others in place, from the given z, and where others are in place at first also from
    its own starts: alone it may have taken the form that says best what is theirs. The nuisances of `null` are fitted;
    they are again beside other effects."""
    values = dict(enumerate(z))
    refits: dict[int, Refit] = {}
    for sweep in range(SWEEPS if len(effects) > 1 else 1):
        for k, effect in enumerate(effects):
            others = [(effects[j], values[j]) for j in range(len(effects)) if j != k]
            # Beside other effects the nuisances are others: what an effect took up is theirs no longer.
            problem = in_place(null, others)
            if others:
                problem = refitted(problem)
            # Values that are read off the data (steps of rounding) stay.
            read = effect.name in FINEST
            fitted_values = {n: np.asarray(v) for n, v in to_values(effect, values[k]).items()}
            starts: list[tuple[dict[str, Any], ...]] = [(fitted_values,)]
            if sweep == 0 and others and effect.starts and not read:
                starts.append(effect.starts)
            fits = [fit(effect, problem, problem.ev.all_blocks, starts=start, steps=80, fixed=read) for start in starts]
            result = min(fits, key=lambda one: one.loss)
            values[k] = result.z
            refits[k] = Refit(effect, problem, result)
    return tuple(refits[k] for k in range(len(effects)))


def refitted(problem: Problem) -> Problem:
    """The null fitted again to the problem's rays, with the effects that are in place."""
    return fit_null(problem.scan, problem.ev, problem.ev.all_blocks, clutter=problem.clutter)[0]
