"""What the network sees of a painted frame: channels in the order that the config lists them.

Surroundings are means and spreads of grey and of range over squares of several sizes. What a surface is like has to be
told from how it looks beside its neighbours. A network can learn such measures, from many drives; from few it learns
more where it is given them. Those of grey are in units of the frame's own exposure, so that a darker camera changes
little.
"""

from __future__ import annotations

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, Painted
from jaxsim.geometry import resample

SIZES = (3, 7, 15)
"""Cells to a side of the squares."""
COLOURED = (3, 7)
"""Of these the mean angle of incidence and mean colours are given, too."""
LINES = (-4, -2, 2, 4)
"""Lines above and below whose range and incidence are given."""
AROUND = 3 + 6 * len(SIZES) + 3 * len(COLOURED) + 2 * len(LINES)
_MIDDLE = 2.5  # ln of 12 m: squares of what lies about 0 lose no digits
_DARKEST = 0.02

_Raster = Float[Array, "*b rows columns"]
ROW_OCTAVES = 6
"""Waves over the sensor's height: 1, 2, 4 ... 32, the last of about two lines for a sensor of 64."""
BEAMS = 64
"""Places in the sensor that get a channel of `beam`: its lines, where it has no more."""

INPUT_CHANNELS: dict[str, int | None] = {
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


def surroundings(painted: Painted, incidence_rad: _Raster) -> Float[Array, "*b rows columns channels"]:
    """AROUND numbers of about -1..1 a cell; means are over the cells that the camera saw, 0 where there are none.

    The frame's exposure (grey, mean, spread); of each size grey beside its mean, that mean, the spread of grey, the
    spread of ln range, ln range beside its mean, the share of seen cells; of some the mean incidence, red - blue and
    green - grey; of each line above and below ln range beside the cell's own, and the incidence.
    """
    seen = painted.valid
    weight = seen.astype(jnp.float32)
    known = lambda value: jnp.where(seen, value, 0.0)  # noqa: E731
    grey, exposure = _exposed(jnp.asarray(painted.rgb).mean(-1), seen)
    away = known(jnp.log(jnp.clip(painted.range_m, 1.0, 120.0)) - _MIDDLE)
    angle = incidence_rad / (jnp.pi / 2)
    warm = known(2 * (painted.rgb[..., 0] - painted.rgb[..., 2]))
    green = known(2 * (painted.rgb[..., 1] - painted.rgb.mean(-1)))

    channels = [grey, *exposure]
    for size in SIZES:
        count = _over(weight, size)
        mean = lambda value: _over(value, size) / jnp.maximum(count, 1.0)  # noqa: B023, E731
        of_grey, of_range = mean(grey), mean(away)
        channels += [
            known(grey - of_grey),
            known(of_grey),
            _root(mean(grey**2) - of_grey**2),
            3 * _root(mean(away**2) - of_range**2),
            known(2 * (away - of_range)),
            2 * count / size**2 - 1,
        ]
        if size in COLOURED:
            channels += [2 * mean(known(angle)) - 1, 3 * mean(warm), 3 * mean(green)]
    for step in LINES:
        both = _line(weight, step) * weight
        channels += [both * 2 * (_line(away, step) - away), both * (2 * _line(angle, step) - 1)]
    return jnp.stack(channels, axis=-1)


def _exposed(grey: _Raster, seen: Bool[Array, "*b rows columns"]) -> tuple[_Raster, tuple[_Raster, _Raster]]:
    """Grey in units of the frame's own spread about its mean; and that mean and spread."""
    count = jnp.maximum(seen.astype(jnp.float32).sum((-2, -1), keepdims=True), 1.0)
    mean = jnp.where(seen, grey, 0.0).sum((-2, -1), keepdims=True) / count
    square = jnp.where(seen, (grey - mean) ** 2, 0.0).sum((-2, -1), keepdims=True) / count
    spread = jnp.sqrt(square) + _DARKEST
    fill = lambda value: jnp.broadcast_to(value, grey.shape)  # noqa: E731
    return jnp.where(seen, (grey - mean) / spread, 0.0), (fill(2 * mean - 1), fill(4 * spread - 1))


def _root(square: _Raster) -> _Raster:
    return jnp.sqrt(jnp.maximum(square, 0.0))


def _over(value: _Raster, size: int) -> _Raster:
    """Sums over squares of so many cells to a side; nothing lies beyond the raster."""
    half = size // 2
    for axis in (value.ndim - 2, value.ndim - 1):
        padded = jnp.pad(value, [(half, half) if i == axis else (0, 0) for i in range(value.ndim)])
        parts = [jax.lax.slice_in_dim(padded, k, k + value.shape[axis], axis=axis) for k in range(size)]
        value = sum(parts[1:], parts[0])
    return value


def _line(value: _Raster, step: int) -> _Raster:
    """What the line `step` below sees; beyond the window its outermost line."""
    rows = np.clip(np.arange(value.shape[-2]) + step, 0, value.shape[-2] - 1)
    return value[..., rows, :]


def input_channels(prepare: PrepareConfig) -> int:
    """Number of channels of the config's inputs. Raises ValueError for a repeated one, or for none."""
    inputs = prepare.inputs
    if not inputs or len(set(inputs)) < len(inputs):
        raise ValueError(f"inputs: {' '.join(inputs) or 'none'}; name at least one, each once")
    return sum(INPUT_CHANNELS[name] or len(prepare.classes) for name in inputs)


@partial(jax.jit, static_argnames="prepare")
def network_inputs(
    painted: Painted,
    incidence_rad: Float[Array, "*b rows columns"],
    row_share: Float[Array, "*b rows #columns"],
    *,
    prepare: PrepareConfig,
) -> Float[Array, "*b r c channels"]:
    """Scales a window to the network's size and stacks the channels that `prepare.inputs` names; `row_share` may have
    one column that stands for all.

    Colours, lengths and angle are scaled to -1..1. Classes are one-hot over `prepare.classes`, all 0
    for *don't care*: another class, an occluded cell, and where nothing was painted. Edges are 0 or 1, found
    after the scaling as pix2pixHD does. A cell that nothing was painted on is -1 in colour and lengths.
    """
    input_channels(prepare)
    size, lead = prepare.network_size, row_share.ndim - 2
    painted, incidence_rad = resample((painted, incidence_rad), size, batch_dims=lead)
    row_share = resample(row_share, (size[0], 1 if row_share.shape[-1] == 1 else size[1]), batch_dims=lead)
    seen = painted.valid

    def of_row(code: Array) -> Array:
        # Behind the barrier waves are worked out once a row; fused into what stacks the channels, twice a cell.
        return jnp.broadcast_to(jax.lax.optimization_barrier(code), (*seen.shape, code.shape[-1]))

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
        "row": lambda: of_row(_row_code(row_share)),
        "beam": lambda: of_row(
            jax.nn.one_hot(jnp.round(row_share * (BEAMS - 1)).astype(jnp.int32), BEAMS, dtype=jnp.float32)
        ),
        "surroundings": lambda: surroundings(painted, incidence_rad),
    }
    return jnp.concatenate([make[name]() for name in prepare.inputs], axis=-1)


def _row_code(row_share: Float[Array, "*b r c"]) -> Float[Array, "*b r c code"]:
    """A laser line as its place in the sensor, -1 top to 1 bottom, and waves of that place.

    Every laser has a gain of its own: a smooth ramp does not tell neighbouring lines apart, a wave of two lines does.
    """
    # Octaves: each wave is half as long as the one before.
    octaves = jnp.arange(ROW_OCTAVES, dtype=jnp.float32)[(None,) * row_share.ndim]
    phase = 2 * jnp.pi * row_share[..., None] * 2.0**octaves
    return jnp.concatenate([2 * row_share[..., None] - 1, jnp.sin(phase), jnp.cos(phase)], axis=-1)


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
