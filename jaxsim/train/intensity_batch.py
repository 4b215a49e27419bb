"""Pairs as the intensity network's train step takes them: its inputs, what it is to say, and what counts."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from jaxsim.config import PrepareConfig
from jaxsim.frame import LOST_BELOW, Array, Pair
from jaxsim.geometry import resample
from jaxsim.prepare import network_inputs


def make_batch(
    prepare: PrepareConfig, *, drop_weight: float = 1.0, unseen_weight: float = 0.0, occluded_weight: float = 0.0
) -> Callable[[Pair], dict[str, Array]]:
    """Jitted: batched pairs to what the train step takes, at the network's size.

    The reconstruction term counts the cells that the camera saw and that are not occluded; those that did not
    come back with `drop_weight`, those that the camera did not see with `unseen_weight`, the occluded ones with
    `occluded_weight`.
    """

    @jax.jit
    def to_batch(pair: Pair) -> dict[str, Array]:
        # Lost rays are learned as intensity 0; how much they count beside measured ones is a setting.
        returned = jnp.where(pair.measured.valid, 1.0, drop_weight).astype(jnp.float32)
        seen = jnp.where(pair.painted.valid, 1.0, unseen_weight).astype(jnp.float32)
        counts = jnp.where(pair.painted.occluded, jnp.float32(occluded_weight), 1.0) * seen * returned
        rasters = (pair.target, counts, pair.measured.valid)
        target, weight, came_back = resample(rasters, prepare.network_size, batch_dims=1)
        return {
            "inputs": network_inputs(pair.painted, pair.incidence_rad, pair.row_share, prepare=prepare),
            "target": 2 * target[..., None] - 1,
            "weight": weight,
            "returned": came_back,
            # A reading that rounds to 0 counts as lost: the network's 0 stands for both.
            "dropped": ~came_back | (target < LOST_BELOW),
        }

    return to_batch
