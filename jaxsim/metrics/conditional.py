"""Intensity given range, incidence and class: what a histogram of intensity hides.

Two sensors may report the same readings, each of them of the wrong surface. So the Wasserstein-1 distance between
both laws of intensity is taken within each bin of what a reading depends on, and averaged with the share of the
measured rays in the bin. The distance from all bins together can only be smaller (where both sides have the bins in
the same shares).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.frame import CLASSES, Array

RANGE_EDGES_M = (5.0, 8.0, 12.0, 18.0, 26.0, 38.0, 55.0)
INCIDENCE_EDGES_RAD = tuple(float(x) for x in np.deg2rad((15.0, 30.0, 45.0, 60.0, 70.0, 78.0, 84.0)))
READINGS = 101
"""Intensity 0, 0.01, ..., 1: KITTI's own steps."""
FEWEST_RAYS = 50
"""Rays that a bin needs on both sides to be compared."""
CONDITIONS = {"class": (0,), "range": (1,), "incidence": (2,), "all": (0, 1, 2)}
"""What intensity is conditioned on -> axes of the table that are kept."""


def _bin(values: Array, edges: tuple[float, ...]) -> Array:
    # As many edges as a value has passed: bin 0 lies below the first.
    return sum((values >= edge).astype(jnp.int32) for edge in edges)


@jax.jit
def intensity_table(
    intensity: Float[Array, "*b r c"],
    range_m: Float[Array, "*b r c"],
    incidence_rad: Float[Array, "*b r c"],
    *,
    incidence_known: Bool[Array, "*b r c"],
    semantic: Int[Array, "*b r c"],
    valid: Bool[Array, "*b r c"],
) -> Int[Array, "34 8 9 101"]:
    """Number of returns of each class, bin of range, bin of incidence (last: not known) and step of intensity."""
    shape = (CLASSES, len(RANGE_EDGES_M) + 1, len(INCIDENCE_EDGES_RAD) + 2, READINGS)
    angle = jnp.where(incidence_known, _bin(incidence_rad, INCIDENCE_EDGES_RAD), shape[2] - 1)
    kind = jnp.clip(semantic, 0, CLASSES - 1).astype(jnp.int32)
    reading = jnp.clip(jnp.round(intensity * (READINGS - 1)), 0, READINGS - 1).astype(jnp.int32)
    # A ray that did not come back is given a class beyond the table, and dropped.
    cell = (jnp.where(valid, kind, CLASSES), _bin(range_m, RANGE_EDGES_M), angle, reading)
    return jnp.zeros(shape, jnp.int32).at[cell].add(1, mode="drop")


class ConditionalDistance(NamedTuple):
    """A distance between laws of intensity."""

    distance: float
    """Mean Wasserstein-1 distance over bins, in units of intensity (0..1); NaN where no bin can be compared."""
    floor: float
    """What two draws of one law would score, were all rays independent (they are not: read it as a least value)."""
    share: float
    """Share of the measured rays that lie in bins that were compared."""
    rays: int
    """Measured rays that were compared."""


def _compared(a: Float[np.ndarray, "k steps"], b: Float[np.ndarray, "k steps"]) -> ConditionalDistance:
    n, m = a.sum(1), b.sum(1)
    enough = (n >= FEWEST_RAYS) & (m >= FEWEST_RAYS)
    if not enough.any():
        return ConditionalDistance(float("nan"), float("nan"), 0.0, 0)
    weight = m[enough] / m[enough].sum()
    # On a line the Wasserstein-1 distance is the area between both distribution functions.
    first = np.cumsum(a[enough], 1) / a[enough].sum(1, keepdims=True)
    second = np.cumsum(b[enough], 1) / b[enough].sum(1, keepdims=True)
    step = 1 / (READINGS - 1)
    distance = np.abs(first - second).sum(1) * step
    # Of two draws of one law, the pooled counts are the best guess of that law.
    both = (a[enough] + b[enough]).cumsum(1) / (n + m)[enough][:, None]
    # Mean absolute value of a Gaussian difference of two empirical distribution functions.
    spread = np.sqrt(both * (1 - both) * (1 / n[enough] + 1 / m[enough])[:, None])
    floor = np.sqrt(2 / np.pi) * spread.sum(1) * step
    return ConditionalDistance(
        float(weight @ distance), float(weight @ floor), float(m[enough].sum() / m.sum()), int(m[enough].sum())
    )


def conditional_intensity(
    simulated: Int[np.ndarray, "34 8 9 101"], measured: Int[np.ndarray, "34 8 9 101"], *, classes: bool = True
) -> dict[str, ConditionalDistance]:
    """Distances between two tables: `intensity` over all rays alike, then given class, range, incidence, all.

    `classes` False where the frames of a side have none: then `all` is range and incidence. Raises ValueError where a
    side has no return.
    """
    a = np.asarray(simulated, np.float64)
    b = np.asarray(measured, np.float64)
    if not classes:
        # The side that has them would lie in other bins than the one without.
        a, b = a.sum(0, keepdims=True), b.sum(0, keepdims=True)
    if not (a.sum() and b.sum()):
        raise ValueError("conditional: a set has no returns")
    distances = {"intensity": _compared(a.reshape(-1, READINGS).sum(0)[None], b.reshape(-1, READINGS).sum(0)[None])}
    for name, axes in CONDITIONS.items():
        if name == "class" and not classes:
            continue
        others = tuple(axis for axis in range(3) if axis not in axes)
        of_a, of_b = a.sum(others).reshape(-1, READINGS), b.sum(others).reshape(-1, READINGS)
        distances[f"intensity_given_{name}"] = _compared(of_a, of_b)
    return distances
