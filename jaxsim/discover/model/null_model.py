"""The null model: the simulation as it is, with its nuisances fitted; effects fitted beside one another on top of it;
and what it says of the power of echoes.

No file holds an echo's power. The simulator's rests on its table of reflectances, and on its angles. How far it is
off, the measured intensities tell: surface by surface on average, and ray by ray as a spread.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import ANSWER_STEPS, ENOUGH, Fit, Problem, fit, fit_noise, in_place
from jaxsim.discover.model.likelihood import MOST_LIKELY, log_lost
from jaxsim.discover.model.noise import START, Noise, intensity_variance, reading_variance
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.parameters import host_values
from jaxsim.discover.model.random_effects import NormalEquations, conditional_residuals, normal_equations
from jaxsim.discover.rules import RULES
from jaxsim.effects import Law
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.rays import Rays, Scan
from jaxsim.frame import Array

NULL_ROUNDS = 2
"""Rounds of noise given weights and weights given noise."""
FEW = 5.0
"""Compared rays up to which a surface is thought to be like its class, and a class like all."""
SWEEPS = 2
"""Passes over several effects, each fitted beside the others."""


@jax.jit
def residual_spread(
    ev: Evidence, noise: Noise
) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"], Float[Array, "b c r"]]:
    """Standard deviations of ln I (nats) and of the range (m); and the probability that a ray does not return."""
    gone = jnp.clip(ev.rays.column_loss, 0, MOST_LIKELY)
    # Lost with its column, or else alone.
    p = jnp.clip(gone + (1 - gone) * jnp.exp(log_lost(ev.rays, ev, noise)), 1e-4, 1 - 1e-4)
    return jnp.sqrt(intensity_variance(ev, noise)), jnp.sqrt(reading_variance(ev.rays, ev, noise)), p


class Residuals(NamedTuple):
    """One channel's residuals, ray by ray."""

    off: Float[np.ndarray, "b c r"]
    """The residual in its own unit: nats, m, or share lost."""
    z: Float[np.ndarray, "b c r"]
    """The residual over its standard deviation; of drops, over that of a coin of its probability."""
    counts: Bool[np.ndarray, "b c r"]
    """Where the two mean something."""


def residuals(problem: Problem, in_fit: Float[np.ndarray, " b"]) -> dict[str, Residuals]:
    """The residuals of each channel; shared levels follow from the `in_fit` blocks. z has standard deviation 1 where it
    counts."""
    by_channel = _off_and_sd(problem, in_fit.astype(np.float32))
    return {name: _standardised(*map(np.asarray, by_channel[name]), heavy_tails=name != "drop") for name in CHANNELS}


def _off_and_sd(problem: Problem, in_fit: Float[np.ndarray, " b"]) -> dict[str, tuple[Array, Array, Array]]:
    """How far each reading is off, its standard deviation, and whether it counts, by channel."""
    ev = problem.ev
    off_i, off_r = conditional_residuals(ev, problem.equations, jnp.asarray(in_fit))
    sd_i, sd_r, p = residual_spread(ev, problem.noise)
    return {
        "intensity": (off_i, sd_i, ev.compared),
        "range": (off_r, sd_r, ev.smooth),
        "drop": ((~ev.returned).astype(jnp.float32) - p, jnp.sqrt(p * (1 - p)), ev.rays.hit),
    }


def _standardised(
    off: Float[np.ndarray, "b c r"],
    sd: Float[np.ndarray, "b c r"],
    counts: Bool[np.ndarray, "b c r"],
    *,
    heavy_tails: bool,
) -> Residuals:
    z = off / sd
    # Of returns there are no tails: a lost ray is as far off as its probability says.
    if heavy_tails:
        z = np.clip(z, -RULES.most_residual_sd, RULES.most_residual_sd)
    return Residuals(off, z / max(float(z[counts].std()), 1e-3) if counts.any() else z, counts)


def standardised(
    problem: Problem,
) -> tuple[Rays, dict[str, tuple[Float[np.ndarray, "b c r"], Bool[np.ndarray, "b c r"]]]]:
    """Rays on the host; each channel's standardised residuals, all blocks being fitted, and where they count."""
    host = jax.tree.map(np.asarray, problem.ev.rays)
    by_channel = residuals(problem, problem.ev.all_blocks)
    return host, {name: (residual.z, residual.counts) for name, residual in by_channel.items()}


def fit_null(
    scan: Scan, ev: Evidence, in_fit: Float[np.ndarray, " b"] | None = None, *, clutter: bool = False
) -> Problem:
    """Fits noise scales, rates, reflectances and poses of the rays as they stand, to the blocks with `in_fit` 1, by
    default to all.

    Robust weights need residuals, residuals need weights: noise and weights are fitted in turn, NULL_ROUNDS times, and
    the noise once more; then the weights stay, for all effects that are held against this null.
    """
    in_fit = ev.all_blocks if in_fit is None else in_fit
    noise, residuals = START, first_residuals(ev)
    for _ in range(NULL_ROUNDS):
        problem = Problem(scan, ev, normal_equations(ev, noise, residuals), noise, clutter)
        noise = fit_noise(problem, in_fit).noise
        residuals = conditional_residuals(ev, problem.equations, jnp.asarray(in_fit, jnp.float32))
    problem = Problem(scan, ev, normal_equations(ev, noise, residuals), noise, clutter)
    noise = fit_noise(problem, in_fit).noise
    # Effects that cut by power see it as uncertain as it is.
    ev = with_power_spread(ev, noise, implied_level(ev, problem.equations))
    return replace(problem, ev=ev, noise=noise)


def reweighted(problem: Problem, in_fit: Float[np.ndarray, " b"]) -> Problem:
    """Random effects weighed by the residuals that the problem itself leaves, not by those of its null."""
    # Weights follow from residuals and these from weights: the first round's are rough, the second's serve.
    raw = normal_equations(problem.ev, problem.noise, first_residuals(problem.ev))
    off = conditional_residuals(problem.ev, raw, jnp.asarray(in_fit))
    return replace(problem, equations=normal_equations(problem.ev, problem.noise, off))


@dataclass(frozen=True)
class Refit:
    """An effect fitted with all others in place."""

    effect: Law
    problem: Problem
    """The problem in which it was fitted."""
    fit: Fit


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
            starts: list[tuple[dict[str, Any], ...]] = [(host_values(effect, values[k]),)]
            if sweep == 0 and others and effect.starts and not read:
                starts.append(effect.starts)
            fits = [fit(effect, problem, starts=start, steps=ANSWER_STEPS, fixed=read) for start in starts]
            # What says the same stays where it is: borders between rays that are looked at have no likelihood.
            result = next((other for other in fits[1:] if other.loss < fits[0].loss - ENOUGH), fits[0])
            values[k] = result.z
            refits[k] = Refit(effect, problem, result)
    return tuple(refits[k] for k in range(len(effects)))


def refitted(problem: Problem) -> Problem:
    """The null fitted again to the problem's rays, with the effects that are in place."""
    return fit_null(problem.scan, problem.ev, clutter=problem.clutter)


@jax.jit
def first_residuals(ev: Evidence) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"]]:
    """Residuals of ln I less their median, and of the range (m), before any nuisance; 0 where not compared."""
    residual = jnp.where(ev.compared, ev.log_intensity - ev.rays.log_intensity, jnp.nan)
    # The median is the gain, roughly: without it every ray would be far off, and weigh little.
    of_intensity = jnp.where(ev.compared, residual - jnp.nanmedian(residual), 0)
    return of_intensity, jnp.where(ev.smooth, ev.range_m - ev.rays.reading_m, 0)


def implied_level(ev: Evidence, eq: NormalEquations) -> Float[np.ndarray, "b c r"]:
    """Nats by which each ray's surface is brighter than simulated: of its compared rays, its class's where it has few,
    all rays' where the class has few. 0 where nothing is hit."""
    hit, compared = np.asarray(ev.rays.hit), np.asarray(ev.compared)
    # What the random effects explain is brightness of surfaces; what they do not is noise of rays.
    residual = np.where(compared, np.asarray(ev.log_intensity) - np.asarray(ev.rays.log_intensity), 0)
    unexplained, _ = conditional_residuals(ev, eq, ev.all_blocks)
    explained = np.asarray(residual - np.asarray(unexplained), float)
    level = np.full(hit.shape, explained[compared].mean() if compared.any() else 0.0)
    # From coarse to fine: each group is off what the coarser ones say.
    for group in (np.asarray(ev.rays.semantic), np.asarray(ev.surface)[np.asarray(ev.strip)]):
        _, of = np.unique(group, return_inverse=True)
        of = of.reshape(-1)
        count = np.bincount(of, compared.reshape(-1))
        total = np.bincount(of, np.where(compared, explained, 0).reshape(-1))
        # Shrinkage: the mean of a group's own rays, as if FEW more had read what is known already.
        expected = np.bincount(of, np.where(compared, level, 0).reshape(-1)) / np.maximum(count, 1)
        level = level + ((total - count * expected) / (count + FEW))[of].reshape(group.shape)
    return np.where(hit, level, 0)


def with_power_spread(ev: Evidence, noise: Noise, level: Float[np.ndarray, "b c r"] | None = None) -> Evidence:
    """Rays that know how uncertain their power is: what intensities scatter by, ray by ray, and, where `level` is given
    and stays uncorrected, what surfaces differ by."""
    variance = intensity_variance(ev, noise)
    if level is not None and ev.rays.hit.any():
        variance = variance + float(level[jax.device_get(ev.rays.hit)].var())
    return replace(ev, rays=replace(ev.rays, log_power_sd=jnp.sqrt(variance).astype(jnp.float32)))


def as_implied(ev: Evidence, noise: Noise, eq: NormalEquations) -> Evidence:
    """Rays as bright as the measured intensities say that their surfaces are."""
    level = jnp.asarray(implied_level(ev, eq), jnp.float32)
    rays = replace(ev.rays, log_power=ev.rays.log_power + level, log_intensity=ev.rays.log_intensity + level)
    return with_power_spread(replace(ev, rays=rays), noise)
