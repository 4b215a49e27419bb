"""Products of matrices in float32's own precision, on every device.

An NVIDIA GPU rounds the factors of a float32 product to 11 significant bits (TF32), and a TPU to 8 (bfloat16), unless
it is told otherwise. Training bears that in its networks' layers; geometry, statistics and what repeats a published
number do not: in 11 bits 50 m are up to 2 cm off.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp

PRECISION = jax.lax.Precision.HIGHEST
"""Of convolutions that must not round either."""

einsum = partial(jnp.einsum, precision=PRECISION)
matmul = partial(jnp.matmul, precision=PRECISION)
tensordot = partial(jnp.tensordot, precision=PRECISION)
