"""What free curves reach with the same data: the floor of a gap.

A generalised additive model (Hastie & Tibshirani 1990) in place of an effect: curves along the effect's covariates,
added to ln I and to the reading (robust least squares, as the likelihood's Student-t asks for), and to the log odds of
a lost return (logistic regression). Curves are of means; scatter stays what it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.find.localise import COVARIATES, curve_basis, values_of
from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.likelihood import DEGREES
from jaxsim.discover.model.residuals import residuals, spread
from jaxsim.discover.rules import RULES

STEPS = 20
"""Of both regressions: either has long converged by then."""
Design = Float[np.ndarray, "n k"]
Line = Float[np.ndarray, " n"]


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


def additive_floor(problem: Problem, fitted: Float[np.ndarray, " b"], covariates: Sequence[str]) -> Curves:
    """Free curves along `covariates`, learned from the fitted blocks."""
    rays = jax.tree.map(np.asarray, problem.ev.rays)
    sd_i, sd_r, lost = [np.asarray(x, float) for x in spread(problem.ev, problem.noise)]
    by_channel = residuals(problem, fitted)
    train = np.asarray(fitted) > 0

    def curves(name: str, scale: np.ndarray) -> Float[np.ndarray, "b c r"]:
        off, _, counts = by_channel[name]
        design = [curve_basis(values_of(one, rays, counts), one) for one in COVARIATES if one in covariates]
        x = np.concatenate([np.ones((int(counts.sum()), 1), np.float32), *design], axis=1)
        learn = np.broadcast_to(train[:, None, None], counts.shape)[counts]
        regress = log_odds if name == "drop" else robust
        prediction = np.zeros(counts.shape, np.float32)
        prediction[counts] = x @ regress(x[learn], off[counts][learn].astype(float), scale[counts][learn])
        return prediction

    odds = lost / (1 - lost)
    # log1p(-p) is -log1p(odds of p).
    kept = np.log1p(odds) - np.log1p(odds * np.exp(curves("drop", lost)))
    return Curves(curves("intensity", sd_i), curves("range", sd_r), kept.astype(np.float32))


def robust(x: Design, y: Line, sd: Line) -> Float[np.ndarray, " k"]:
    """Coefficients by iteratively reweighted least squares, Student-t errors of scale `sd`."""
    beta = np.zeros(x.shape[1])
    for _ in range(STEPS):
        weight = (DEGREES + 1) / (DEGREES + ((y - x @ beta) / sd) ** 2) / sd**2
        beta = _solved(x, weight, x.T @ (weight * y), ridge=RULES.ridge * weight.mean())
    return beta


def log_odds(x: Design, off: Line, p: Line) -> Float[np.ndarray, " k"]:
    """Coefficients of what is added to the log odds of `p`, where `off` is what happened (0 or 1) less p."""
    beta = np.zeros(x.shape[1])
    happened = off + p
    begin = np.log(p / (1 - p))
    ridge = RULES.ridge * float(np.mean(p * (1 - p)))
    for _ in range(STEPS):
        now = 1 / (1 + np.exp(-(begin + x @ beta)))
        step = _solved(x, now * (1 - now), x.T @ (happened - now) - ridge * beta, ridge=ridge)
        # Newton's steps are too long where what is rare turns out to be common.
        beta = beta + step * min(1.0, 1 / max(float(np.abs(step).max()), 1e-9))
    return beta


def _solved(x: Design, weight: Line, right: np.ndarray, *, ridge: float) -> Float[np.ndarray, " k"]:
    return np.linalg.solve(x.T @ (weight[:, None] * x) + ridge * np.eye(x.shape[1]), right)
