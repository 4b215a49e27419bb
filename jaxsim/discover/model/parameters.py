"""An effect's parameters as they are fitted: z = (value - neutral) / scale; 0 does nothing, 1 is clearly visible."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.effects import Effect
from jaxsim.frame import Array

LOOSE = 3.0
"""The prior on a scalar parameter is this many times its scale; vectors are shrunk to theirs."""


def fitted_parameters(effect: Effect) -> dict[str, Any]:
    return {name: p for name, p in effect.parameters.items() if p.fitted}


def to_values(effect: Effect, z: dict[str, Array]) -> dict[str, Array]:
    """Parameters in their units."""
    values: dict[str, Any] = {name: p.neutral for name, p in effect.parameters.items() if not p.fitted}
    return values | {name: p.neutral + p.scale * z[name] for name, p in fitted_parameters(effect).items()}


def to_z(effect: Effect, values: dict[str, Any], rows: int, *, dtype: type = np.float32) -> dict[str, np.ndarray]:
    """Of a start; parameters that it does not name are neutral."""
    z = {}
    for name, p in fitted_parameters(effect).items():
        value = (np.asarray(values.get(name, p.neutral), dtype) - p.neutral) / p.scale
        z[name] = np.broadcast_to(value, p.dims(rows)).astype(dtype)
    return z


def prior(effect: Effect, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Standard deviation and bounds of every z, in the order of the raveled dict."""
    parts: dict[str, Any] = {}
    for name, p in fitted_parameters(effect).items():
        one = np.ones(p.dims(rows), np.float32)
        sd = LOOSE if p.shape == "scalar" else 1.0
        parts[name] = [sd * one, one * (p.low - p.neutral) / p.scale, one * (p.high - p.neutral) / p.scale]
    sd, low, high = (flat({name: part[k] for name, part in parts.items()}) for k in range(3))
    return sd, low, high


def flat(tree: Any) -> Float[np.ndarray, " n"]:
    """All leaves behind one another, in the order of `jax.tree.leaves`."""
    leaves = [np.ravel(np.asarray(leaf)) for leaf in jax.tree.leaves(tree)]
    return np.concatenate(leaves).astype(np.float64) if leaves else np.zeros(0)


def restorer(tree: Any) -> Callable[[Float[np.ndarray, " n"]], Any]:
    """What makes of such a vector a tree of float32 arrays of the same shapes."""
    leaves, form = jax.tree.flatten(tree)
    shapes = [np.shape(leaf) for leaf in leaves]
    ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])

    def restore(x: np.ndarray) -> Any:
        x = np.asarray(x, np.float32)
        return form.unflatten([x[ends[k] : ends[k + 1]].reshape(shape) for k, shape in enumerate(shapes)])

    return restore
