"""Trees of numbers as one vector and back, on the host: a fit does this at every step, and JAX would dispatch an
operation for each leaf."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Float


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
