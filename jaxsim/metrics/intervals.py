"""Intervals over scenes: what so few of them can say of a mean, a ratio, or any score.

Scenes are few, and the percentile bootstrap is too narrow then: of five normal scenes its 90 % interval covers 77 %
(tests/metrics/test_intervals.py shows it). Student's t with the scenes' own scatter covers what it says. Of what is no
mean, the jackknife gives that scatter (Efron & Tibshirani 1993, ch. 11).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.special import stdtrit

LEVEL = 0.90
"""Coverage of every interval."""


def student_reach(scenes: int | np.integer | Int[np.ndarray, "*k"]) -> float | Float[np.ndarray, "*k"]:
    """Standard errors to either side of a mean over so many scenes within which it lies at LEVEL."""
    # One scene has no scatter, and its callers say NaN; 1 keeps the quantile a number until then.
    return stdtrit(np.maximum(np.subtract(scenes, 1), 1), 0.5 + LEVEL / 2)


def half_width(values: Float[np.ndarray, "s *k"]) -> Float[np.ndarray, "*k"]:
    """Half width of the interval of each mean over scenes; NaN entries do not count, NaN where fewer than two are
    left."""
    known = np.isfinite(values)
    n = known.sum(0)
    centre = np.where(known, values, 0).sum(0) / np.maximum(n, 1)
    squares = np.where(known, (values - centre) ** 2, 0).sum(0)
    width = student_reach(n) * np.sqrt(squares / np.maximum(n - 1, 1) / np.maximum(n, 1))
    return np.where(n > 1, width, np.nan)


def known_mean(values: Float[np.ndarray, " s"]) -> float:
    """Mean over the scenes that have a value; NaN where none has."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def mean_interval(values: Float[np.ndarray, " s"]) -> tuple[float, float]:
    """Interval of a mean over scenes; NaN where fewer than two scenes have a value."""
    centre = known_mean(values)
    half = float(half_width(values))
    return centre - half, centre + half


def jackknife_half_width(without: Float[np.ndarray, "g *k"]) -> Float[np.ndarray, "*k"]:
    """Half width of the interval of each statistic, from what it becomes without each of the scenes, or of g groups of
    them: these are farther apart than they look, since any two share scenes, and by that the factor widens them."""
    n = len(without)
    return np.asarray(student_reach(n) * (n - 1) / np.sqrt(n) * without.std(0, ddof=1))


def ratio_interval(top: Float[np.ndarray, " s"], bottom: Float[np.ndarray, " s"]) -> tuple[float, float]:
    """Interval of mean(top) / mean(bottom), by the jackknife over scenes that have both."""
    both = np.isfinite(top) & np.isfinite(bottom)
    top = top[both]
    bottom = bottom[both]
    n = len(top)
    if n < 2:
        return float("nan"), float("nan")
    # Of sums: a mean of the scenes' ratios would be ruled by those that have next to nothing below. Where one scene has
    # all of it, nothing is left without that one.
    with np.errstate(divide="ignore", invalid="ignore"):
        without = (top.sum() - top) / (bottom.sum() - bottom)
        return jackknife_interval(float(top.sum() / bottom.sum()), without)


def jackknife_interval(value: float, without: Float[np.ndarray, " s"]) -> tuple[float, float]:
    """Interval of a value that becomes `without` each of the scenes; NaN where there are fewer than two, or where it
    is no number without one of them (a PSNR whose errors were all in that one)."""
    if len(without) < 2 or not np.isfinite([value, *without]).all():
        return float("nan"), float("nan")
    half = float(jackknife_half_width(without))
    return float(value - half), float(value + half)
