"""How far simulation and measurement are apart on judge scenes, which nothing was fitted to, before and after.

Each channel has an error that an engineer reads off: the mean absolute error of ln I (nats) and of the range (m, at
most 1) on the rays that both sides compare, and the log loss of return (nats a ray). And it has a log-likelihood, in
which effects are named: it also knows scatter, lattices and rare readings, that a mean error does not see.
Nuisances that frames share come from the find scenes; a frame's own (objects, pose) are fitted before and after alike.
Each scene is its own pair: intervals are those of its differences (`scenes`).

The floor is what free curves reach with the same data: a generalised additive model (Hastie & Tibshirani 1990) in place
of an effect, curves along the effect's covariates, added to ln I and to the reading (robust least squares, as the
likelihood's Student-t asks for), and to the log odds of a lost return (logistic regression). Curves are of means;
scatter stays what it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.find.covariates import COVARIATES, curve_basis, values_of
from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.likelihood import log_likelihood, log_lost, rounding_gain
from jaxsim.discover.model.noise import DEGREES, Noise
from jaxsim.discover.model.null_model import residual_spread, residuals
from jaxsim.discover.model.random_effects import NormalEquations, conditional_residuals
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict.parts import Gained, Gap, Interval
from jaxsim.effects.effect import CHANNELS
from jaxsim.frame import Array
from jaxsim.metrics.intervals import known_mean, mean_interval, ratio_interval

ERROR_UNITS = {
    "intensity": "mean absolute error of ln I",
    "range": "mean absolute error, m",
    "drop": "log loss of return, nats a ray",
}
REGRESSION_STEPS = 20
"""Steps of both regressions: either has long converged by then."""
Design = Float[np.ndarray, "n k"]
_Line = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Distance:
    """The distance of each judge scene (s) in each channel."""

    error: Float[np.ndarray, "s 3"]
    """Mean errors in ERROR_UNITS; NaN where nothing is compared."""
    log_likelihood: Float[np.ndarray, "s 3"]
    """Nats."""


@dataclass(frozen=True)
class BlockDistances:
    """What each block (b) adds to its scene's distance."""

    error: Float[np.ndarray, "b 3 2"]
    """Sums of errors in ERROR_UNITS, and counts of rays."""
    log_likelihood: Float[np.ndarray, "b 3"]
    """Nats."""


def block_distances(problem: Problem, in_fit: Float[np.ndarray, " b"], eq: NormalEquations) -> BlockDistances:
    """What each block adds, with what scenes share from the fitted ones. Likelihoods are to be held against each other
    at the same weights `eq`, as in naming: a problem's own would price reflectances and poses differently."""
    shared = np.asarray(in_fit, np.float32)
    off_i, off_r = conditional_residuals(problem.ev, problem.equations, shared)
    errors = np.asarray(_errors(problem.ev, problem.noise, off_i=off_i, off_r=off_r))
    score = np.asarray(log_likelihood(problem.ev, problem.noise, equations=eq, in_fit=shared, clutter=problem.clutter))
    rays = problem.ev.rays
    steps = {"intensity_quantization": float(rays.intensity_step), "range_quantization": float(rays.range_step_m)}
    # The likelihood is of continuous readings; what a lattice tells is counted apart.
    return BlockDistances(errors, score + rounding_gain(problem.ev, steps))


def distance(
    problem: Problem, in_fit: Float[np.ndarray, " b"], eq: NormalEquations, *, scene: Int[np.ndarray, " b"]
) -> Distance:
    """The distance of the scenes of those blocks that are not fitted, as `block_distances` has them."""
    judged = np.asarray(in_fit) == 0
    of_blocks = block_distances(problem, in_fit, eq)
    scenes, index = np.unique(scene[judged], return_inverse=True)
    total = np.zeros((len(scenes), 3, 2))
    scores = np.zeros((len(scenes), 3))
    np.add.at(total, index, of_blocks.error[judged])
    np.add.at(scores, index, of_blocks.log_likelihood[judged])
    with np.errstate(invalid="ignore"):
        return Distance(np.where(total[..., 1] > 0, total[..., 0] / np.maximum(total[..., 1], 1), np.nan), scores)


@jax.jit
def _errors(
    ev: Evidence, noise: Noise, *, off_i: Float[Array, "b c r"], off_r: Float[Array, "b c r"]
) -> Float[Array, "b 3 2"]:
    """Sums and counts of each block's errors by channel."""
    rays, smooth = ev.rays, ev.rays.hit & ev.returned & ~ev.edge
    # A ray does not return where its whole packet is lost, or of its own.
    gone = jnp.clip(rays.column_loss, 0, 0.999)
    lost = jnp.logaddexp(jnp.log1p(-gone) + log_lost(rays, ev, noise), jnp.log(gone + 1e-9))
    # Probabilities of 0 and 1 are claims that one ray could refute for ever.
    lost = jnp.clip(lost, -30.0, -1e-7)
    miss = -jnp.where(ev.returned, jnp.log(-jnp.expm1(lost)), lost)
    # A ray that met another surface is wrong, and not by how far the other stands.
    wrong = jnp.minimum(jnp.abs(off_r), RULES.most_off_m)
    pairs = ((jnp.abs(off_i), ev.compared), (wrong, smooth), (miss, rays.hit))
    sums = [jnp.where(counts, x, 0).sum((1, 2)) for x, counts in pairs]
    counts = [counts.sum((1, 2)).astype(jnp.float32) for _, counts in pairs]
    return jnp.stack([jnp.stack(sums, -1), jnp.stack(counts, -1)], axis=-1)


def gaps(before: Distance, after: Distance, *, placebo: Distance, floor: Distance) -> dict[str, Gap]:
    """Each channel's mean errors, and what its log-likelihood gains."""
    result = {}
    for k, name in enumerate(CHANNELS):
        gain = _gain(before, after)[:, k]
        gained = Gained(
            float(gain.mean()),
            *mean_interval(gain),
            # Floor and placebo start from the same `before`: they are other answers to one question.
            floor=float(_gain(before, floor)[:, k].mean()),
            placebo=float(_gain(before, placebo)[:, k].mean()),
            win_rate=float((gain > 0).mean()),
        )
        result[name] = gap_of(
            before.error[:, k],
            after.error[:, k],
            placebo=placebo.error[:, k],
            floor=floor.error[:, k],
            unit=ERROR_UNITS[name],
            gained=gained,
        )
    return result


def gap_of(
    before: Float[np.ndarray, " s"],
    after: Float[np.ndarray, " s"],
    *,
    placebo: Float[np.ndarray, " s"],
    floor: Float[np.ndarray, " s"],
    unit: str,
    gained: Gained | None = None,
) -> Gap:
    """The gap of one channel, of each judge scene's errors in `unit`; NaN where nothing is compared."""
    shrunk = before - after
    return Gap(
        known_mean(before),
        known_mean(after),
        *mean_interval(shrunk),
        unit=unit,
        floor=known_mean(floor),
        placebo=known_mean(placebo),
        # A scene that was not compared is neither won nor lost.
        win_rate=known_mean(np.where(np.isfinite(shrunk), shrunk > 0, np.nan)),
        gained=gained,
    )


def closure(before: Distance, after: Distance, *, floor: Distance, channels: Iterable[str]) -> Interval | None:
    """What the log-likelihood of the named effects' channels gains, as a share of what it gains with free curves (the
    floor)."""
    used = [k for k, name in enumerate(CHANNELS) if name in set(channels)]
    # Channels that no named effect touches would only add their noise.
    gain = _gain(before, after)[:, used].sum(1)
    return share_of(gain, _gain(before, floor)[:, used].sum(1), unit="share of what free curves gain")


def share_of(gain: Float[np.ndarray, " s"], room: Float[np.ndarray, " s"], *, unit: str) -> Interval | None:
    """What the judge scenes gain of what there is to gain; none where they do not agree that there is anything."""
    if not mean_interval(room)[0] > 0:
        return None
    return Interval(float(gain.sum() / room.sum()), *ratio_interval(gain, room), unit)


def _gain(before: Distance, after: Distance) -> Float[np.ndarray, "s 3"]:
    return after.log_likelihood - before.log_likelihood


@dataclass(frozen=True)
class Curves:
    """What free curves add to each ray (b, c, r)."""

    log_intensity: Float[np.ndarray, "b c r"]
    reading_m: Float[np.ndarray, "b c r"]
    log_keep: Float[np.ndarray, "b c r"]

    def on(self, ev: Evidence, keep: Bool[np.ndarray, " b"] | slice = slice(None)) -> Evidence:
        """The evidence with the curves in place of an effect; it holds the blocks `keep` of those of the curves."""
        fields = {name: getattr(ev.rays, name) + getattr(self, name)[keep] for name in self.__dataclass_fields__}
        return replace(ev, rays=replace(ev.rays, **fields))


def additive_floor(problem: Problem, in_fit: Float[np.ndarray, " b"], covariates: Sequence[str]) -> Curves:
    """Free curves along `covariates`, learned from the fitted blocks."""
    rays = jax.tree.map(np.asarray, problem.ev.rays)
    sds = [np.asarray(sd, float) for sd in residual_spread(problem.ev, problem.noise)]
    lost = sds[2]
    by_channel = residuals(problem, in_fit)
    train = np.asarray(in_fit) > 0

    def curves(name: str, scale: np.ndarray) -> Float[np.ndarray, "b c r"]:
        off, _, counts = by_channel[name]
        design = [curve_basis(values_of(name, rays, counts), name) for name in COVARIATES if name in covariates]
        x = np.concatenate([np.ones((int(counts.sum()), 1), np.float32), *design], axis=1)
        # Of find scenes alone: what it reaches on judge scenes is held out as the answer's is.
        learn = np.broadcast_to(train[:, None, None], counts.shape)[counts]
        # One regression a channel: means of ln I and of readings add up, probabilities do on their log odds.
        regress = log_odds if name == "drop" else robust
        prediction = np.zeros(counts.shape, np.float32)
        prediction[counts] = x @ regress(x[learn], off[counts][learn].astype(float), scale[counts][learn])
        return prediction

    odds = lost / (1 - lost)
    # log1p(-p) is -log1p(odds of p).
    log_keep = np.log1p(odds) - np.log1p(odds * np.exp(curves("drop", lost)))
    return Curves(curves("intensity", sds[0]), curves("range", sds[1]), log_keep.astype(np.float32))


def robust(x: Design, y: _Line, sd: _Line) -> Float[np.ndarray, " k"]:
    """Coefficients by iteratively reweighted least squares, Student-t errors of scale `sd`."""
    beta = np.zeros(x.shape[1])
    for _ in range(REGRESSION_STEPS):
        # Student-t as a mixture of normals (EM): a far residual is one of a wide component.
        weight = (DEGREES + 1) / (DEGREES + ((y - x @ beta) / sd) ** 2) / sd**2
        beta = _solved(x, weight, x.T @ (weight * y), ridge=RULES.ridge * weight.mean())
    return beta


def log_odds(x: Design, off: _Line, p: _Line) -> Float[np.ndarray, " k"]:
    """Coefficients of what is added to the log odds of `p`, where `off` is what happened (0 or 1) less p."""
    beta = np.zeros(x.shape[1])
    happened = off + p
    begin = np.log(p / (1 - p))
    # In units of a ray's own information, so that rare and common losses are held alike.
    ridge = RULES.ridge * float(np.mean(p * (1 - p)))
    for _ in range(REGRESSION_STEPS):
        now = 1 / (1 + np.exp(-(begin + x @ beta)))
        step = _solved(x, now * (1 - now), x.T @ (happened - now) - ridge * beta, ridge=ridge)
        # Newton's steps are too long where what is rare turns out to be common.
        beta = beta + step * min(1.0, 1 / max(float(np.abs(step).max()), 1e-9))
    return beta


def _solved(x: Design, weight: _Line, right: np.ndarray, *, ridge: float) -> Float[np.ndarray, " k"]:
    return np.linalg.solve(x.T @ (weight[:, None] * x) + ridge * np.eye(x.shape[1]), right)
