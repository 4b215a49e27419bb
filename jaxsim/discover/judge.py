"""What judge scenes show of the effects that were added: scenes that nothing was fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.add import in_place
from jaxsim.discover.evidence import Evidence
from jaxsim.discover.fit import Problem
from jaxsim.discover.localise import COVARIATES
from jaxsim.discover.name import Choice
from jaxsim.discover.nuisance import weights
from jaxsim.discover.null import first_residuals, left_over
from jaxsim.discover.result import CurveLine
from jaxsim.discover.show import by_scene, curves_along, distances, floors, gaps, maps_of
from jaxsim.discover.survey import Candidate
from jaxsim.discover.verdict import Gap, Interval
from jaxsim.effects import Effect


@dataclass(frozen=True)
class Judged:
    """Gaps by channel, the closure, and what a report draws (`Result` says what maps and curves hold)."""

    gap: dict[str, Gap]
    closure: Interval | None
    maps_before: dict[str, Float[np.ndarray, "r c"]]
    maps_after: dict[str, Float[np.ndarray, "r c"]]
    curves: tuple[CurveLine, ...]


def judge(
    scan: Any,
    ev: Evidence,
    unit: np.ndarray,
    find: int,
    null: Problem,
    noise: Any,
    chain: list[tuple[Effect, Any]],
    rival: Candidate | None,
) -> Judged:
    """The gap with the effects of `chain` in place, which leave `noise`; `rival` is the placebo. The first `find` units
    are find scenes, from which shared nuisances come."""
    fitted = (unit < find).astype(np.float32)
    judged = unit >= find

    def problem_of(effects: Sequence[tuple[Effect, Any]], noise: Any) -> Problem:
        problem = in_place(Problem(scan, ev, null.weights, noise, null.clutter), effects, simulated=True)
        raw = weights(problem.ev, noise, *first_residuals(problem.ev))
        off = left_over(problem.ev, raw, jnp.asarray(fitted))
        return replace(problem, weights=weights(problem.ev, noise, *off))

    def distance(problem: Problem) -> np.ndarray:
        found = distances(problem.ev.rays, problem.ev, problem.noise, problem.weights, jnp.asarray(fitted))
        return by_scene(np.asarray(found)[judged], unit[judged])

    before, after = problem_of([], null.noise), problem_of(chain, noise)
    placebo = problem_of([(rival.effect, rival.fits[0].z)], null.noise) if rival else before
    channels = {name for effect, _ in chain for name in effect.channels}
    covariates = {name for effect, _ in chain for name in effect.covariates} or set(COVARIATES)
    floor = floors(before, fitted, judged, unit, distance(before), sorted(covariates))
    gap, closure = gaps(distance(before), distance(after), distance(placebo), floor, sorted(channels))
    return Judged(
        gap,
        closure,
        maps_of(before, fitted, judged),
        maps_of(after, fitted, judged),
        curves_along(before, after, fitted, judged, unit, [effect for effect, _ in chain]),
    )


def runner_up(choice: Choice) -> Candidate | None:
    """The best candidate of the first step that is neither named nor a look-alike."""
    if not choice.steps:
        return None
    first = choice.steps[0]
    taken = {first.chosen.effect.name, *(c.effect.name for c in first.alike)}
    rest = [c for c in first.ranking if c.effect.name not in taken]
    return rest[0] if rest else None
