"""What judge scenes show of the effects that were added: scenes that nothing was fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.add import in_place
from jaxsim.discover.find.localise import COVARIATES
from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem, fit
from jaxsim.discover.model.lattice import FINEST
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.null import first_residuals, fit_null
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.model.random_effects import conditional_residuals, normal_equations
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import Choice
from jaxsim.discover.show.additive_floor import black_box
from jaxsim.discover.show.distance import Distance, distance
from jaxsim.discover.show.gap import closure, gaps
from jaxsim.discover.show.residual_curves import curves_along
from jaxsim.discover.show.residual_maps import maps_of
from jaxsim.discover.verdict import Judged
from jaxsim.effects import Effect

Added = Sequence[tuple[Effect, dict[str, Any]]]
"""Effects and their z."""


def judge(
    scan: Any,
    ev: Evidence,
    unit: np.ndarray,
    find: int,
    null: Problem,
    noise: Noise,
    chain: Added,
    placebo: tuple[Added, Noise] | None,
) -> Judged:
    """The gap with the effects of `chain` in place, which leave `noise`; `placebo` is another chain with its own. The
    first `find` units are find scenes, from which shared nuisances come."""
    fitted = (unit < find).astype(np.float32)
    judged = unit >= find

    def problem_of(effects: Added, noise: Noise) -> Problem:
        problem = Problem(scan, ev, null.equations, noise, null.clutter)
        return settled(in_place(problem, effects, simulated=True))

    def settled(problem: Problem) -> Problem:
        """With the weights that its own residuals have."""
        raw = normal_equations(problem.ev, problem.noise, *first_residuals(problem.ev))
        off = conditional_residuals(problem.ev, raw, jnp.asarray(fitted))
        return replace(problem, equations=normal_equations(problem.ev, problem.noise, *off))

    before, after = problem_of([], null.noise), problem_of(chain, noise)
    instead = problem_of(*placebo) if placebo else before
    channels = {name for effect, _ in chain for name in effect.channels}
    covariates = {name for effect, _ in chain for name in effect.covariates} or set(COVARIATES)
    curves = black_box(before, fitted, sorted(covariates))
    find_alone = np.ones(int(fitted.sum()), np.float32)
    curved, _ = fit_null(scan, curves.on(null.ev, fitted > 0), find_alone, clutter=null.clutter)
    free = settled(replace(before, ev=curves.on(ev), noise=curved.noise))

    def far(problem: Problem) -> Distance:
        return distance(problem, fitted, before.equations, unit)

    was, now, rival, floor = (far(problem) for problem in (before, after, instead, free))
    return Judged(
        gaps(was, now, rival, floor),
        closure(was, now, floor, channels),
        maps_of(before, fitted, judged),
        maps_of(after, fitted, judged),
        curves_along(before, after, fitted, judged, unit, [effect for effect, _ in chain]),
    )


def runner_up(choice: Choice) -> Candidate | None:
    """The best candidate of the first step that is nowhere named and no look-alike of what is."""
    if not choice.steps:
        return None
    taken = {one.effect.name for step in choice.steps for one in (step.chosen, *step.alike)}
    rest = [one for one in choice.steps[0].ranking if one.effect.name not in taken]
    return rest[0] if rest else None


def placebo_of(null: Problem, rival: Candidate, everyone: Float[np.ndarray, " b"]) -> tuple[Added, Noise]:
    """The runner-up fitted as the answer is: to all find scenes, from the best of its folds' fits; and the noise that
    it leaves."""
    effect = rival.effect
    starts = tuple(to_values(effect, one.z) for one in rival.fits)
    found = fit(effect, null, everyone, starts=starts, steps=80, fixed=effect.name in FINEST)
    chain = [(effect, found.z)]
    placed = in_place(null, chain)
    return chain, fit_null(placed.scan, placed.ev, everyone, clutter=placed.clutter)[0].noise
