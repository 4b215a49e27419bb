"""Vectors of the ray caster: three component rasters, first axis 3, so that the inner loops run over rays."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.frame import Array


def vector(x: Float[Array, "*r"], y: Float[Array, "*r"], z: Float[Array, "*r"]) -> Float[Array, "3 *r"]:
    """Joins three components."""
    return jnp.stack([x, y, z])


def dot(a: Float[Array, "3 *r"], b: Float[Array, "3 *s"]) -> Float[Array, "*r"]:
    """Scalar product; b may be a single vector."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def unit(v: Float[Array, "3 *r"]) -> Float[Array, "3 *r"]:
    """The direction of v; zero stays zero."""
    return v / jnp.maximum(jnp.sqrt(dot(v, v)), 1e-9)[None]


def turned(rotation: Float[Array, "3 3"], v: Float[Array, "3 *r"]) -> Float[Array, "3 *r"]:
    """Rotates v; written out, because a matrix product may round coarsely on an accelerator."""
    return vector(*(rotation[i, 0] * v[0] + rotation[i, 1] * v[1] + rotation[i, 2] * v[2] for i in range(3)))
