"""Fits an effect together with the nuisances.

The likelihood is compiled once for all effects: each effect's own function is small, and the chain rule joins them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.gradients import Back, placed, seen_through, slopes_back, value_and_slopes
from jaxsim.discover.model.likelihood import CHANNELS
from jaxsim.discover.model.nuisance import LEAST, MOST, Noise, Weights
from jaxsim.discover.model.parameters import flat, prior, restorer, to_z
from jaxsim.discover.scenes import folds
from jaxsim.effects import Law
from jaxsim.effects.rays import Rays, Scan
from jaxsim.frame import Array

NOISE_SD = 2.0
"""Prior of the noise scales and rates about where they start."""
ENOUGH = 0.05
"""Nats of a step below which a fit is done."""
CLUTTER = ("fog_backscatter", "precipitation_clutter", "interference")
NOTHING = Law(name="nothing", parameters={}, channels=CHANNELS, apply=lambda p, rays: rays)


@dataclass(frozen=True)
class Problem:
    """What fits share: the rays as they stand, the comparison, and the null's noise."""

    scan: Scan
    ev: Evidence
    weights: Weights
    noise: Noise
    clutter: bool = False
    """Rays already carry clutter."""
    loss: float = 1e4
    """Of the null: the scale of a fit's loss."""
    basis: Float[Array, "b c r k"] | None = None
    """What free curves are made of (`Rays.basis`); the likelihood knows nothing of it."""

    @cached_property
    def null_fits(self) -> list[Fit]:
        """The null on each fold (`folds`)."""
        return [fit(NOTHING, self, fitted, steps=100, enough=1e-3) for fitted in folds(np.asarray(self.ev.unit))]


@dataclass(frozen=True)
class Fit:
    """One effect, fitted on some blocks."""

    z: dict[str, np.ndarray]
    noise: Noise
    score: Float[np.ndarray, "b 3"]
    """Log-likelihood of every block by channel; 0 in channels that the effect leaves alone."""
    loss: float


def channels_of(effect: Law) -> tuple[str, ...]:
    """The channels whose likelihood an effect can change; range and drop are one mixture."""
    returns = ("range", "drop") if {"range", "drop"} & set(effect.channels) else ()
    return (*(("intensity",) if "intensity" in effect.channels else ()), *returns)


def rays_for(effect: Law, ev: Evidence) -> Rays:
    """The rays that an effect is fitted to. One that moves readings with the reported intensity is held against the
    intensity that was reported: the predicted one is off by more than the effect's law is wide."""
    if "intensity" in effect.channels or "intensity" not in effect.covariates:
        return ev.rays
    return replace(ev.rays, log_intensity=jnp.where(ev.returned, ev.log_intensity, ev.rays.log_intensity))


class Objective:
    """Minus the log-likelihood of an effect's z and of the noise, as one vector x, with their priors."""

    def __init__(self, effect: Law, problem: Problem, fitted: Float[np.ndarray, " b"], noise: Noise | None = None):
        self.effect, self.problem, self.rows = effect, problem, problem.ev.rays.row.shape[-1]
        self.rays = replace(rays_for(effect, problem.ev), basis=problem.basis)
        self.fitted = jnp.asarray(fitted, jnp.float32)
        self.channels, self.clutter = channels_of(effect), problem.clutter or effect.name in CLUTTER
        level = noise or problem.noise
        neutral = (to_z(effect, {}, self.rows), level)
        self.first, self.restore = flat(neutral), restorer(neutral)
        self.own = len(self.first) - len(jax.tree.leaves(level))
        sd, low, high = prior(effect, self.rows)
        self.sd = np.concatenate([sd, np.full(len(self.first) - self.own, NOISE_SD)])
        self.bounds = [
            *zip(low, high, strict=True),
            *[(LEAST.get(name), MOST.get(name)) for name in level.__dataclass_fields__],
        ]
        self.centre = np.concatenate([np.zeros(self.own), self.first[self.own :]])

    def start(self, values: dict[str, Any]) -> np.ndarray:
        return np.concatenate([flat(to_z(self.effect, values, self.rows)), self.first[self.own :]])

    def blocks(self, x: np.ndarray, counted: Array | None = None) -> tuple[Any, Noise, Any, Back]:
        z, level = self.restore(x)
        seen, taken, back = seen_through(self.effect, z, self.rays, self.problem.scan)
        return z, level, self.blocks_of(seen, taken, level, counted), back

    def blocks_of(
        self, seen: dict[str, Array], taken: dict[str, Array], level: Noise, counted: Array | None = None
    ) -> Any:
        """Of rays as an effect leaves them."""
        p, counted = self.problem, self.fitted if counted is None else counted
        return value_and_slopes(
            seen, taken, p.ev, level, p.weights, self.fitted, counted, channels=self.channels, clutter=self.clutter
        )

    def data(self, x: np.ndarray, counted: Array | None = None) -> tuple[float, np.ndarray]:
        """Value and slope without the priors."""
        z, _, (value, _, by_seen, by_noise), back = self.blocks(x, counted)
        by_z = slopes_back(back, by_seen) if self.own else z
        return float(value), flat((by_z, by_noise))

    def __call__(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = self.data(x)
        away = (x - self.centre) / self.sd
        value, slope = value + 0.5 * float(away @ away), slope + away / self.sd
        return (value, slope) if np.isfinite(value) and np.isfinite(slope).all() else (1e12, np.zeros_like(x))


def fit(
    effect: Law,
    problem: Problem,
    fitted: Float[np.ndarray, " b"],
    *,
    starts: tuple[dict[str, Any], ...] | None = None,
    steps: int = 40,
    enough: float = ENOUGH,
    fixed: bool = False,
) -> Fit:
    """Fits `effect` and the noise on the blocks with `fitted` 1, on top of what `problem.ev.rays` already say.

    Begins at the best of `starts` (values; by default the effect's own and neutral); `fixed` keeps the effect there.
    """
    objective = Objective(effect, problem, fitted)
    begin = [objective.start(start) for start in (({}, *effect.starts) if starts is None else starts)]
    if len(begin) > 1:
        begin = [min(begin, key=lambda x: float(objective.blocks(x)[2][0]))]
    held = [(v, v) for v in begin[0][: objective.own]]
    bounds = [*held, *objective.bounds[objective.own :]] if fixed else objective.bounds
    # Stop where a step gains less than ENOUGH nats; SciPy asks for it as a fraction of the loss.
    options = {"maxiter": steps, "ftol": enough / max(abs(problem.loss), 1.0), "maxcor": 12}
    found = minimize(objective, begin[0], jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    z, level, (_, blocks, _, _), _ = objective.blocks(found.x)
    return Fit(jax.tree.map(np.asarray, z), level, np.asarray(blocks), float(found.fun))


def score_at(
    effect: Law, problem: Problem, fitted: Float[np.ndarray, " b"], z: dict[str, np.ndarray], noise: Noise
) -> Float[np.ndarray, "b 3"]:
    """Log-likelihood of every block by channel at given values, nothing fitted."""
    objective = Objective(effect, problem, fitted)
    return np.asarray(objective.blocks(flat((z, noise)))[2][1])


def partway(
    effect: Law, problem: Problem, fitted: Float[np.ndarray, " b"], found: Fit, share: float
) -> Float[np.ndarray, "b 3"]:
    """Log-likelihood of every block by channel at `share` of the way from `problem`'s null to a fit.

    The way is that of what the effect does to each ray, not of its parameters: a quarter of a distance or of a
    threshold may do nothing at all.
    """
    objective = Objective(effect, problem, fitted)
    null, _ = objective.restore(objective.start({}))
    rays, scan = objective.rays, problem.scan
    before, after = (
        (*seen_through(effect, z, rays, scan)[:2], noise)
        for z, noise in ((null, problem.noise), (found.z, found.noise))
    )
    return np.asarray(objective.blocks_of(*_between(before, after, jnp.float32(share)))[1])


Stage = tuple[dict[str, Array], dict[str, Array], Noise]


@jax.jit
def _between(before: Stage, after: Stage, share: Array) -> Stage:
    """Rays and noise at `share` of the way; rays that hit where they did not before, or the reverse, stay."""
    (old, taken, noise), (new, hits, changed) = before, after
    same = taken["hit"] == hits["hit"]

    def mix(a: Array, b: Array) -> Array:
        mixed = a + share * (b - a)
        return jnp.where(same & jnp.isfinite(mixed), mixed, a) if a.ndim else mixed

    return {name: mix(old[name], new[name]) for name in old}, taken, jax.tree.map(mix, noise, changed)


def on_top(effect: Law, problem: Problem, z: dict[str, np.ndarray], *, simulated: bool = False) -> Problem:
    """The problem with an effect in place: as it was fitted (`rays_for`), or as a simulation has it, which knows no
    reported intensities."""
    ev = problem.ev
    given = ev.rays if simulated else rays_for(effect, ev)
    rays = placed(effect, z, given, problem.scan)
    if given is not ev.rays:
        rays = replace(rays, log_intensity=ev.rays.log_intensity)
    return replace(problem, ev=replace(ev, rays=rays), clutter=problem.clutter or effect.name in CLUTTER)
