"""Products of matrices in float32's own precision, on every device; and inverses.

An NVIDIA GPU rounds the factors of a float32 product to 11 significant bits (TF32), and a TPU to 8 (bfloat16), unless
it is told otherwise. Training bears that in its networks' layers; geometry, statistics and what repeats a published
number do not: in 11 bits 50 m are up to 2 cm off.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

PRECISION = jax.lax.Precision.HIGHEST
"""Of convolutions that must not round either."""

einsum = partial(jnp.einsum, precision=PRECISION)
matmul = partial(jnp.matmul, precision=PRECISION)
tensordot = partial(jnp.tensordot, precision=PRECISION)


def inverse(matrices: Float[Array, "n p p"]) -> Float[Array, "n p p"]:
    """Inverses of symmetric positive definite matrices, by Gauss and Jordan's elimination without pivots, which these
    do not need.

    `jnp.linalg.inv` of several matrices hands them to LAPACK in threads of the pool that runs it, and waits there: two
    such calls at once on two cores wait for each other for ever (jaxlib 0.10).
    """

    def eliminate(k: Int[Array, ""], a: Float[Array, "n p p"]) -> Float[Array, "n p p"]:
        column, pivot = a[:, :, k], a[:, k, k]
        row = (a[:, k] / pivot[:, None]).at[:, k].set(1 / pivot)
        # What stands in the column itself is the inverse's so far.
        cleared = a.at[:, :, k].set(0) - column[:, :, None] * row[:, None, :]
        return cleared.at[:, k].set(row)

    return jax.lax.fori_loop(0, matrices.shape[-1], eliminate, matrices)
