"""Between the polar window and the network: pairs to batches, images back to intensity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, Painted, Pair
from jaxsim.geometry import resample
from jaxsim.prepare import network_inputs

Generate = Callable[[Any, Array], Array]
"""(parameters, inputs (b, h, w, c)) -> image (b, h, w, 1) in [-1, 1]."""
STEP = 0.01  # KITTI's sensor reports hundredths, 0.99 at most


def make_batch(
    prepare: PrepareConfig, *, drop_weight: float = 1.0, unseen_weight: float = 0.0
) -> Callable[[Pair], dict[str, Array]]:
    """Jitted: batched pairs to what the train step takes, at the network's size.

    The reconstruction term counts the cells that the camera saw and that are not occluded; those that did not
    come back with `drop_weight`, those that the camera did not see with `unseen_weight`.
    """

    @jax.jit
    def to_batch(pair: Pair) -> dict[str, Array]:
        returned = jnp.where(pair.measured.valid, 1.0, drop_weight).astype(jnp.float32)
        seen = jnp.where(pair.painted.valid, 1.0, unseen_weight).astype(jnp.float32)
        counts = jnp.where(pair.painted.occluded, 0.0, seen * returned)
        target, weight = resample((pair.target, counts), prepare.network_size, batch_dims=1)
        return {
            "inputs": network_inputs(pair.painted, pair.incidence_rad, pair.row, prepare=prepare),
            "target": 2 * target[..., None] - 1,
            "weight": weight,
        }

    return to_batch


def predict_intensity(
    generate: Generate,
    params: Any,
    painted: Painted,
    incidence_rad: Float[Array, "*b rows columns"],
    row: Float[Array, "*b rows columns"],
    *,
    prepare: PrepareConfig,
) -> Float[Array, "*b rows columns"]:
    """Intensity 0..0.99 in steps of 1/100 on the polar window; 0 is a ray that does not come back.

    The window is scaled to the network's size cell by cell and back, so each cell keeps its own answer.
    """
    *batch, rows, columns = row.shape
    inputs = network_inputs(painted, incidence_rad, row, prepare=prepare)
    image = generate(params, inputs.reshape(-1, *inputs.shape[-3:]))[..., 0]
    image = resample(image.reshape(*batch, *image.shape[-2:]), (rows, columns), batch_dims=len(batch))
    return jnp.clip(jnp.round((image + 1) / 2 / STEP), 0, 99) * STEP


def make_predict(generate: Generate, prepare: PrepareConfig) -> Callable[[Any, Pair], Array]:
    """Jitted: (parameters, pair or batch of pairs) -> intensity on the polar window."""

    @jax.jit
    def predict(params: Any, pair: Pair) -> Array:
        return predict_intensity(generate, params, pair.painted, pair.incidence_rad, pair.row, prepare=prepare)

    return predict
