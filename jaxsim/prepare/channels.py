"""What the network sees of a painted frame: channels in the order that the config lists them."""

from __future__ import annotations

import math
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, Painted
from jaxsim.geometry import resample
from jaxsim.prepare.surroundings import CHANNELS as AROUND
from jaxsim.prepare.surroundings import surroundings

ROW_OCTAVES = 6
"""Waves over the sensor's height: 1, 2, 4 ... 32, the last of about two lines for a sensor of 64."""
BEAMS = 64
"""Places in the sensor that get a channel of `beam`: its lines, where it has no more."""

CHANNELS: dict[str, int | None] = {
    "rgb": 3,
    "depth": 1,
    "semantic": None,
    "edges": 1,
    "incidence": 1,
    "range": 1,
    "log_range": 1,
    "row": 1 + 2 * ROW_OCTAVES,
    "beam": BEAMS,
    "surroundings": AROUND,
}
"""Channels of each input; None: one a class."""


def input_channels(prepare: PrepareConfig) -> int:
    """Number of channels of the config's inputs. Raises ValueError for a repeated one, or for none."""
    inputs = prepare.inputs
    if not inputs or len(set(inputs)) < len(inputs):
        raise ValueError(f"inputs: {' '.join(inputs) or 'none'}; name at least one, each once")
    return sum(CHANNELS[name] or len(prepare.classes) for name in inputs)


@partial(jax.jit, static_argnames="prepare")
def network_inputs(
    painted: Painted,
    incidence_rad: Float[Array, "*b rows columns"],
    row: Float[Array, "*b rows columns"],
    *,
    prepare: PrepareConfig,
) -> Float[Array, "*b r c channels"]:
    """Scales a window to the network's size and stacks the channels that `prepare.inputs` names.

    Colours, lengths and angle are scaled to -1..1. Classes are one-hot over `prepare.classes`, all 0
    for *don't care*: another class, an occluded cell, and where nothing was painted. Edges are 0 or 1, found
    after the scaling as pix2pixHD does. A cell that nothing was painted on is -1 in colour and lengths.
    """
    input_channels(prepare)
    size, lead = prepare.network_size, row.ndim - 2
    painted, incidence_rad, row = resample((painted, incidence_rad, row), size, batch_dims=lead)
    seen = painted.valid

    def scaled(value: Array, largest: float) -> Array:
        return jnp.where(seen, 2 * jnp.clip(value / largest, 0, 1) - 1, -1)[..., None]

    def semantic() -> Array:
        known = (seen & ~painted.occluded)[..., None]
        # Shaped by hand below: arrays of different rank do not meet in this house.
        ids = jnp.asarray(prepare.classes, jnp.int32)
        return (known & (painted.semantic[..., None] == ids.reshape((1,) * seen.ndim + (-1,)))).astype(jnp.float32)

    make = {
        "rgb": lambda: jnp.where(seen[..., None], 2 * painted.rgb - 1, -1),
        "depth": lambda: scaled(painted.depth_m, prepare.max_range_m),
        "range": lambda: scaled(painted.range_m, prepare.max_range_m),
        "semantic": semantic,
        "edges": lambda: edge_map(painted.semantic, painted.instance)[..., None].astype(jnp.float32),
        "incidence": lambda: (2 * incidence_rad / (jnp.pi / 2) - 1)[..., None],
        "log_range": lambda: scaled(
            jnp.log(jnp.maximum(painted.range_m, 1.0)), math.log(max(prepare.max_range_m, 2.0))
        ),
        "row": lambda: _row_code(row),
        "beam": lambda: jax.nn.one_hot(jnp.round(row * (BEAMS - 1)).astype(jnp.int32), BEAMS, dtype=jnp.float32),
        "surroundings": lambda: surroundings(painted, incidence_rad),
    }
    return jnp.concatenate([make[name]() for name in prepare.inputs], axis=-1)


def _row_code(row: Float[Array, "*b r c"]) -> Float[Array, "*b r c code"]:
    """A laser line as its place in the sensor, -1 top to 1 bottom, and waves of that place.

    Every laser has a gain of its own: a smooth ramp does not tell neighbouring lines apart, a wave of two lines does.
    """
    # Octaves: each wave is half as long as the one before.
    phase = 2 * jnp.pi * row[..., None] * 2.0 ** jnp.arange(ROW_OCTAVES, dtype=jnp.float32)[(None,) * row.ndim]
    return jnp.concatenate([2 * row[..., None] - 1, jnp.sin(phase), jnp.cos(phase)], axis=-1)


@jax.jit
def edge_map(semantic: Int[Array, "*b h w"], instance: Int[Array, "*b h w"]) -> Bool[Array, "*b h w"]:
    """Cells whose class or instance differs from that of a neighbour above, below, left or right (pix2pixHD).

    Both sides of a border are marked; the raster's own border is none. Comparing the pair is the published
    comparison of `semantic * 1000 + instance` for fewer than 1000 instances, and holds beyond.
    """
    down = (semantic[..., 1:, :] != semantic[..., :-1, :]) | (instance[..., 1:, :] != instance[..., :-1, :])
    right = (semantic[..., 1:] != semantic[..., :-1]) | (instance[..., 1:] != instance[..., :-1])
    batch = [(0, 0)] * (semantic.ndim - 2)
    # A pair of neighbours marks both: the mask of the pairs is shifted onto each of the two.
    beside_rows = jnp.pad(down, [*batch, (1, 0), (0, 0)]) | jnp.pad(down, [*batch, (0, 1), (0, 0)])
    beside_columns = jnp.pad(right, [*batch, (0, 0), (1, 0)]) | jnp.pad(right, [*batch, (0, 0), (0, 1)])
    return beside_rows | beside_columns
