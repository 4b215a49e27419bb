"""Rounded readings: the step of the lattice on which values lie, if they lie on one."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

FINEST = {"intensity_quantization": 1e-3, "range_quantization": 1e-3}
"""Effects whose step is read off the values, and the finest step that counts as rounding."""
SHARE = 0.995
"""Share of the values that must lie on a lattice."""
NEAR = 0.02
"""A value lies on a lattice if it is within this share of a step of it."""


def lattice_step(values: Float[np.ndarray, " n"], *, finest: float) -> float:
    """The largest step of which nearly all values are multiples; 0 if there is none above `finest`."""
    x = np.sort(np.asarray(values, np.float64))
    # Few values lie on some lattice by chance.
    if len(x) < 100:
        return 0.0
    gaps = np.diff(x)
    gaps = gaps[gaps > finest / 4]
    if len(gaps) < 5:
        return 0.0
    # On a lattice the commonest gaps between different values are one step, or few.
    smallest = np.quantile(gaps, 0.05)
    for step in (smallest, *np.unique(gaps.round(6))[:5]):
        step = _refined(x, float(step))
        if step > finest and _share(x, step) >= SHARE:
            return step
    return 0.0


def _refined(x: np.ndarray, step: float) -> float:
    """Least squares of the values on their multiples, from coarse values to all."""
    for reach in (20, 200, 2000, 20000):
        k = np.round(x / step)
        few = (k > 0) & (k <= reach)
        if few.any():
            step = float((x[few] @ k[few]) / (k[few] @ k[few]))
    return step


def _share(x: np.ndarray, step: float) -> float:
    """Share of the values that lie on the lattice."""
    return float(np.mean(_on(x, step)))


def _on(x: np.ndarray, step: float) -> Bool[np.ndarray, "*n"]:
    """Whether each value lies on the lattice."""
    off = np.abs(x / step - np.round(x / step))
    # Values kept as float32 carry their own rounding.
    return off < NEAR + 1e-6 * x / step


def log_rounding(values: Float[np.ndarray, "*n"], step: float, *, finest: float) -> Float[np.ndarray, "*n"]:
    """Nats by which each reading is more probable if SHARE of all lie on the lattice of `step` than if they are known
    to `finest`: many where it lies there, and fewer than none where it does not."""
    x = np.asarray(values, np.float64)
    return np.where(_on(x, step), np.log(SHARE * step / finest), np.log(1 - SHARE))
