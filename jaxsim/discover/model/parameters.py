"""An effect's parameters as a fit sees them: the one mapping between values in their units, z, and a vector.

z = (value - neutral) / scale, float32, a dict of the fitted parameters by name: 0 does nothing, 1 is clearly visible.
`ravel` and `restorer` turn any tree of arrays (z, or z and noise) into one float64 vector and back.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.effects import Law, Parameter
from jaxsim.frame import Array

LOOSE = 3.0
"""Prior standard deviation of a scalar z: data may take one number far beyond what is typical. An entry of a vector (a
beam's, a class's) has 1: few rays speak for each, and all are shrunk."""
SPARSE = 0.02
"""Scale of the Cauchy prior of sparse numbers' z: of most it takes what chance says, of a few that stand out nothing
but ln(1 + (z / SPARSE)^2)."""


class Prior(NamedTuple):
    """Every z's prior, in the order of `ravel`: normal about 0, or of sparse numbers Cauchy's, between bounds."""

    sd: Float[np.ndarray, " n"]
    sparse: Bool[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]

    def cost(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Minus the logarithm of the prior's density, up to a constant, and its derivatives."""
        normal, cauchy = np.where(self.sparse, 0, z / self.sd), np.where(self.sparse, z / SPARSE, 0)
        value = 0.5 * float(normal @ normal) + float(np.log1p(cauchy**2).sum())
        return value, normal / self.sd + 2 * cauchy / (1 + cauchy**2) / SPARSE


def fitted_parameters(effect: Law) -> dict[str, Parameter]:
    """The parameters that fits may change, by name in the effect's order; the others stay neutral."""
    return {name: p for name, p in effect.parameters.items() if p.to_fit}


def to_values(effect: Law, z: dict[str, Array]) -> dict[str, Any]:
    """All parameters in their units; differentiable in z."""
    values: dict[str, Any] = {name: p.neutral for name, p in effect.parameters.items() if not p.to_fit}
    return values | {name: p.neutral + p.scale * z[name] for name, p in fitted_parameters(effect).items()}


def host_values(effect: Law, z: dict[str, Array]) -> dict[str, Any]:
    """All parameters in their units as arrays on the host, at which another fit can begin."""
    return {name: np.asarray(value) for name, value in to_values(effect, z).items()}


def to_z(effect: Law, values: dict[str, Any], rows: int, *, dtype: type = np.float32) -> dict[str, np.ndarray]:
    """The z of `values`; parameters that they do not name are neutral, and one number stands for all beams."""
    z = {}
    for name, p in fitted_parameters(effect).items():
        value = (np.asarray(values.get(name, p.neutral), dtype) - p.neutral) / p.scale
        z[name] = np.broadcast_to(value, p.dims(rows)).astype(dtype)
    return z


def prior(effect: Law, rows: int) -> Prior:
    """Every z's prior on a sensor of so many beams."""
    sd = {}
    sparse = {}
    low = {}
    high = {}
    for name, p in fitted_parameters(effect).items():
        # float32, as z: bounds and values meet exactly.
        one = np.ones(p.dims(rows), np.float32)
        sd[name] = one * (LOOSE if p.shape == "scalar" else 1.0)
        sparse[name] = one * p.sparse
        low[name] = one * (p.low - p.neutral) / p.scale
        high[name] = one * (p.high - p.neutral) / p.scale
    return Prior(ravel(sd), ravel(sparse) > 0, ravel(low), ravel(high))


def ravel(tree: Any) -> Float[np.ndarray, " n"]:
    """All leaves behind one another, in the order of `jax.tree.leaves` (dicts by sorted names), as float64."""
    leaves = [np.ravel(np.asarray(leaf)) for leaf in jax.tree.leaves(tree)]
    return np.concatenate(leaves).astype(np.float64) if leaves else np.zeros(0)


def restorer(tree: Any, dtype: type = np.float32) -> Callable[[Float[np.ndarray, " n"]], Any]:
    """The inverse of `ravel`: what makes of a vector a tree of arrays of the shapes in `tree`.

    By default they are float32, which the compiled likelihood takes, where SciPy climbs in float64.
    """
    leaves, form = jax.tree.flatten(tree)
    shapes = [np.shape(leaf) for leaf in leaves]
    ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
    return partial(_restored, form=form, shapes=shapes, ends=ends, dtype=dtype)


def _restored(
    x: Float[np.ndarray, " n"],
    *,
    form: Any,
    shapes: list[tuple[int, ...]],
    ends: Int[np.ndarray, " m"],
    dtype: type,
) -> Any:
    x = np.asarray(x, dtype)
    return form.unflatten([x[ends[k] : ends[k + 1]].reshape(shape) for k, shape in enumerate(shapes)])
