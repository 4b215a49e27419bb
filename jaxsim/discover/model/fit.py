"""Fits an effect together with the noise: the penalised likelihood of z and noise, climbed by L-BFGS-B (`minimum`).

The likelihood is compiled once for all effects: each effect's own function is small, and the chain rule joins them
(`gradients`). Levels and poses follow in closed form at every step (`random_effects`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.gradients import (
    EffectGradient,
    Fields,
    Gradient,
    effect_with_gradient,
    gradient_in_z,
    value_and_gradient,
    with_effect,
)
from jaxsim.discover.model.minimum import Point, minimum
from jaxsim.discover.model.noise import LEAST, MOST, NOISE_SD, Noise
from jaxsim.discover.model.parameters import prior, ravel, restorer, to_z
from jaxsim.discover.model.random_effects import NormalEquations
from jaxsim.discover.scenes import folds
from jaxsim.effects import EFFECTS, Law
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.rays import Rays, Scan
from jaxsim.frame import Array

ENOUGH = 0.05
"""Nats of a step below which a fit is done."""
CANDIDATE_STEPS = 40
"""Steps that a fit of a candidate may take, of which its gain alone counts ..."""
ANSWER_STEPS = 80
"""... and one of what was named, of which the numbers count too."""
NULL_STEPS = 100
"""Steps that a fit of the null may take."""
NULL_ENOUGH = 1e-3
"""What ENOUGH is for the null: every effect's gain is counted from it."""
NO_LOSS = 1e12
"""Loss where a fit has gone to no number: the line search turns back."""
Chain = Sequence[tuple[Law, dict[str, Any]]]
"""Effects and their z, in the order in which they act."""
NOTHING = Law(name="nothing", parameters={}, channels=CHANNELS, apply=lambda p, rays: rays)
"""The effect of the null."""


@dataclass(frozen=True)
class Problem:
    """What fits share: the rays as they stand, the comparison, and the null's noise."""

    scan: Scan
    ev: Evidence
    equations: NormalEquations
    noise: Noise
    clutter: bool = False
    """Rays already carry clutter."""
    basis: Float[Array, "b c r k"] | None = None
    """What free curves are made of (`Rays.basis`); the likelihood knows nothing of it."""

    @cached_property
    def null_fits(self) -> list[Fit]:
        """The null on each fold (`folds`)."""
        return [fit_noise(self, in_fit) for in_fit in folds(np.asarray(self.ev.scene))]


@dataclass(frozen=True)
class Fit:
    """One effect, fitted on some blocks."""

    z: dict[str, np.ndarray]
    noise: Noise
    score: Float[np.ndarray, "b 3"]
    """Log-likelihood of every block by channel; 0 in channels that the effect leaves alone."""
    loss: float


def channels_of(effect: Law) -> tuple[str, ...]:
    """The channels whose likelihood an effect can change."""
    return coupled(effect.channels)


def coupled(channels: Sequence[str]) -> tuple[str, ...]:
    """The channels whose likelihood changes with that of any of these: range and drop are one mixture."""
    returns = ("range", "drop") if {"range", "drop"} & set(channels) else ()
    return (*(("intensity",) if "intensity" in channels else ()), *returns)


def score_columns(effect: Law) -> list[int]:
    """The columns of a score by channel that an effect can change."""
    return [CHANNELS.index(name) for name in channels_of(effect)]


def rays_for(effect: Law, ev: Evidence, *, simulated: bool = False) -> Rays:
    """The rays that an effect is fitted to; or, `simulated`, as a simulation has them, which knows no reported
    intensities. One that moves readings with the reported intensity is held against that: the predicted one is off by
    more than the effect's law is wide. One that moves the whole sensor slides rays along their planes, as a frame's own
    pose does: what else they would meet hangs on that pose, too, and edges cast again by the one without the other
    speak against both."""
    if effect.of_mounting:
        return replace(ev.rays, origin_slope=ev.pose[..., :3])
    if simulated or not by_reported(effect):
        return ev.rays
    return replace(ev.rays, log_intensity=jnp.where(ev.returned, ev.log_intensity, ev.rays.log_intensity))


def by_reported(effect: Law) -> bool:
    """Whether an effect is held against the intensity that was reported. One that changes intensities itself cannot be
    given the measured ones."""
    return "intensity" in effect.covariates and "intensity" not in effect.channels


class Objective:
    """Minus the log-likelihood of an effect's z and of the noise, as one vector x = ravel((z, noise)), with their
    priors; of the blocks with `in_fit` 1, by default of all."""

    def __init__(self, effect: Law, problem: Problem, in_fit: Float[np.ndarray, " b"] | None = None):
        self.effect, self.problem = effect, problem
        in_fit = problem.ev.all_blocks if in_fit is None else in_fit
        self.rows = problem.ev.rays.row.shape[-1]
        self.rays = replace(rays_for(effect, problem.ev), basis=problem.basis)
        self.in_fit = jax.device_put(in_fit.astype(np.float32))
        self.channels, self.clutter = channels_of(effect), problem.clutter or effect.clutter
        neutral = (to_z(effect, {}, self.rows), problem.noise)
        self.first, self.restore = ravel(neutral), restorer(neutral)
        self.own = len(self.first) - len(jax.tree.leaves(problem.noise))
        """Entries of x that are the effect's; the others are the noise's."""
        self.of_z = of_z = prior(effect, self.rows)
        self.sd = np.concatenate([of_z.sd, np.full(len(self.first) - self.own, NOISE_SD)])
        # No bound is None, as SciPy has it.
        of_noise = [(LEAST.get(name), MOST.get(name)) for name in problem.noise.__dataclass_fields__]
        self.bounds = [*zip(of_z.low, of_z.high, strict=True), *of_noise]

    def start(self, values: dict[str, Any]) -> Float[np.ndarray, " n"]:
        """The vector of an effect's values, in their units, and the null's noise."""
        return np.concatenate([ravel(to_z(self.effect, values, self.rows)), self.first[self.own :]])

    def gradient(
        self, x: Float[np.ndarray, " n"], counted: Float[Array, " b"] | None = None
    ) -> tuple[EffectGradient, Gradient]:
        """The effect's rays at x, and the likelihood of the counted blocks (by default the fitted ones)."""
        z, noise = self.restore(x)
        rays = effect_with_gradient(self.effect, z, self.rays, scan=self.problem.scan)
        return rays, self.gradient_at(rays.fields, rays.constant, noise, counted=counted)

    def gradient_at(
        self, fields: Fields, constant: Fields, noise: Noise, *, counted: Float[Array, " b"] | None = None
    ) -> Gradient:
        """The likelihood of rays as an effect leaves them."""
        return value_and_gradient(
            fields,
            constant,
            self.problem.ev,
            noise=noise,
            equations=self.problem.equations,
            in_fit=self.in_fit,
            counted=self.in_fit if counted is None else counted,
            channels=self.channels,
            clutter=self.clutter,
        )

    def data(
        self, x: Float[np.ndarray, " n"], counted: Float[Array, " b"] | None = None
    ) -> tuple[Gradient, Float[np.ndarray, " n"]]:
        """The likelihood and its derivatives in x, without the priors."""
        rays, likelihood = self.gradient(x, counted)
        by_z = gradient_in_z(rays.pullbacks, likelihood.by_fields) if self.own else {}
        return likelihood, ravel((by_z, likelihood.by_noise))

    def __call__(self, x: Float[np.ndarray, " n"]) -> Point:
        """Value and gradient with the normal priors, what the fit lowers; and every block's log-likelihood."""
        likelihood, gradient = self.data(x)
        # z is held to neutral, noise to where the null left it.
        of_z, by_z = self.of_z.cost(x[: self.own])
        moved = (x[self.own :] - self.first[self.own :]) / NOISE_SD
        value = float(likelihood.value) + of_z + 0.5 * float(moved @ moved)
        gradient = gradient + np.concatenate([by_z, moved / NOISE_SD])
        if np.isfinite(value) and np.isfinite(gradient).all():
            return Point(x, value, gradient, likelihood.blocks)
        return Point(x, NO_LOSS, np.zeros_like(x), likelihood.blocks)


def fit(
    effect: Law,
    problem: Problem,
    in_fit: Float[np.ndarray, " b"] | None = None,
    *,
    starts: tuple[dict[str, Any], ...] | None = None,
    steps: int = CANDIDATE_STEPS,
    enough: float = ENOUGH,
    fixed: bool = False,
) -> Fit:
    """Fits `effect` and the noise on the blocks with `in_fit` 1, by default on all, on top of what `problem.ev.rays`
    already say.

    Begins at the best of `starts` (values; by default the effect's own and neutral); `fixed` keeps the effect there.
    """
    in_fit = problem.ev.all_blocks if in_fit is None else in_fit
    objective = Objective(effect, problem, in_fit)
    tried = ({}, *effect.starts) if starts is None else starts
    [start] = best_starts(effect, problem, tried, parts=in_fit[None])
    begin = objective.start(start)
    bounds = objective.bounds
    if fixed:
        bounds = [*[(v, v) for v in begin[: objective.own]], *bounds[objective.own :]]
    best = minimum(objective, begin, sd=objective.sd, bounds=bounds, steps=steps, enough=enough)
    z, noise = objective.restore(best.x)
    return Fit(jax.tree.map(np.asarray, z), noise, np.asarray(best.more), best.loss)


def best_starts(
    effect: Law, problem: Problem, starts: Sequence[dict[str, Any]], *, parts: Float[np.ndarray, "k b"]
) -> list[dict[str, Any]]:
    """Gives, for each part of the blocks (1 in it, 0 not), the likeliest of `starts` there.

    Laws have several basins; one look at each start costs less than a fit from each, and one look does for all parts:
    levels are those of all blocks that are in any.
    """
    if len(starts) == 1:
        return [*starts] * len(parts)
    objective = Objective(effect, problem, parts.max(0))
    looks = [objective.gradient(objective.start(start))[1].blocks for start in starts]
    of_blocks = np.stack([np.asarray(blocks, np.float64).sum(-1) for blocks in looks])
    of_parts = np.where(parts[:, None] > 0, of_blocks[None], 0).sum(-1)
    return [starts[k] for k in np.where(np.isfinite(of_parts), of_parts, -np.inf).argmax(-1)]


def fit_noise(problem: Problem, in_fit: Float[np.ndarray, " b"] | None = None) -> Fit:
    """Fits the noise alone: the null, on the blocks with `in_fit` 1, by default on all."""
    return fit(NOTHING, problem, in_fit, steps=NULL_STEPS, enough=NULL_ENOUGH)


def score_at(
    effect: Law,
    problem: Problem,
    in_fit: Float[np.ndarray, " b"] | None = None,
    *,
    z: dict[str, np.ndarray],
    noise: Noise,
) -> Float[np.ndarray, "b 3"]:
    """Log-likelihood of every block by channel at given values, nothing fitted."""
    _, likelihood = Objective(effect, problem, in_fit).gradient(ravel((z, noise)))
    return np.asarray(likelihood.blocks)


def partway(
    effect: Law, problem: Problem, in_fit: Float[np.ndarray, " b"] | None = None, *, fit: Fit, share: float
) -> Float[np.ndarray, "b 3"]:
    """Log-likelihood of every block by channel at `share` of the way from `problem`'s null to a fit.

    The way is that of what the effect does to each ray, not of its parameters: a quarter of a distance or of a
    threshold may do nothing at all.
    """
    objective = Objective(effect, problem, in_fit)
    neutral, _ = objective.restore(objective.first)
    before = effect_with_gradient(effect, neutral, objective.rays, scan=problem.scan)
    after = effect_with_gradient(effect, fit.z, objective.rays, scan=problem.scan)
    stages = (before.fields, before.constant, problem.noise), (after.fields, after.constant, fit.noise)
    return np.asarray(objective.gradient_at(*_between(*stages, np.float32(share))).blocks)


_Stage = tuple[Fields, Fields, Noise]
"""Fields of the rays, differentiated and constant, and the noise."""


@jax.jit
def _between(before: _Stage, after: _Stage, share: Float[Array, ""]) -> _Stage:
    """Rays and noise at `share` of the way; rays that hit where they did not before, or the reverse, stay."""
    fields_before, constant_before, noise_before = before
    fields_after, constant_after, noise_after = after
    # Between a surface and the sky there is no halfway.
    same = constant_before["hit"] == constant_after["hit"]

    def mix(a: Array, b: Array) -> Array:
        mixed = a + share * (b - a)
        return jnp.where(same & jnp.isfinite(mixed), mixed, a) if a.ndim else mixed

    fields = {name: mix(fields_before[name], fields_after[name]) for name in fields_before}
    return fields, constant_before, jax.tree.map(mix, noise_before, noise_after)


def on_top(effect: Law, problem: Problem, z: dict[str, np.ndarray], *, simulated: bool = False) -> Problem:
    """The problem with an effect in place: as it was fitted, or as a simulation has it (`rays_for`)."""
    ev = problem.ev
    given = rays_for(effect, ev, simulated=simulated)
    rays = with_effect(effect, z, given, scan=problem.scan)
    # Reported intensities and slopes served the law alone: the likelihood keeps the predicted ones.
    if given is not ev.rays:
        rays = replace(rays, log_intensity=ev.rays.log_intensity, origin_slope=None)
    return replace(problem, ev=replace(ev, rays=rays), clutter=problem.clutter or effect.clutter)


def all_on_top(effects: Chain, problem: Problem, *, simulated: bool = False) -> Problem:
    """The problem with effects in place, one `on_top` of another; its nuisances are not refitted."""
    for effect, z in effects:
        problem = on_top(effect, problem, z, simulated=simulated)
    return problem


def in_place(null: Problem, effects: Chain, *, simulated: bool = False) -> Problem:
    """The null with these effects on top, in physical order, learned laws last; its nuisances are not refitted."""
    # Effects do not commute (a ceiling cuts what a gain has raised): the catalogue's order is that of the light's way.
    order = {name: k for k, name in enumerate(EFFECTS)}
    physical = sorted(effects, key=lambda pair: order.get(pair[0].plain_name, len(order)))
    return all_on_top(physical, null, simulated=simulated)
