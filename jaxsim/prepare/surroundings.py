"""What lies around each cell, in numbers: means and spreads of grey and of range over squares of several sizes.

What a surface is like has to be told from how it looks beside its neighbours. A network can learn such measures, from
many drives; from few it learns more where it is given them. Those of grey are in units of the frame's own exposure, so
that a darker camera changes little.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import Array, Painted

SIZES = (3, 7, 15)
"""Cells to a side of the squares."""
COLOURED = (3, 7)
"""Of these the mean angle of incidence and mean colours are given, too."""
LINES = (-4, -2, 2, 4)
"""Lines above and below whose range and incidence are given."""
CHANNELS = 3 + 6 * len(SIZES) + 3 * len(COLOURED) + 2 * len(LINES)
_MIDDLE = 2.5  # ln of 12 m: squares of what lies about 0 lose no digits
_DARKEST = 0.02

Raster = Float[Array, "*b rows columns"]


def surroundings(painted: Painted, incidence_rad: Raster) -> Float[Array, "*b rows columns channels"]:
    """CHANNELS numbers of about -1..1 a cell; means are over the cells that the camera saw, 0 where there are none.

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

    found = [grey, *exposure]
    for size in SIZES:
        count = _over(weight, size)
        mean = lambda value: _over(value, size) / jnp.maximum(count, 1.0)  # noqa: B023, E731
        of_grey, of_range = mean(grey), mean(away)
        found += [
            known(grey - of_grey),
            known(of_grey),
            _root(mean(grey**2) - of_grey**2),
            3 * _root(mean(away**2) - of_range**2),
            known(2 * (away - of_range)),
            2 * count / size**2 - 1,
        ]
        if size in COLOURED:
            found += [2 * mean(known(angle)) - 1, 3 * mean(warm), 3 * mean(green)]
    for step in LINES:
        both = _line(weight, step) * weight
        found += [both * 2 * (_line(away, step) - away), both * (2 * _line(angle, step) - 1)]
    return jnp.stack(found, axis=-1)


def _exposed(grey: Raster, seen: Bool[Array, "*b rows columns"]) -> tuple[Raster, tuple[Raster, Raster]]:
    """Grey in units of the frame's own spread about its mean; and that mean and spread."""
    count = jnp.maximum(seen.astype(jnp.float32).sum((-2, -1), keepdims=True), 1.0)
    mean = jnp.where(seen, grey, 0.0).sum((-2, -1), keepdims=True) / count
    square = jnp.where(seen, (grey - mean) ** 2, 0.0).sum((-2, -1), keepdims=True) / count
    spread = jnp.sqrt(square) + _DARKEST
    fill = lambda value: jnp.broadcast_to(value, grey.shape)  # noqa: E731
    return jnp.where(seen, (grey - mean) / spread, 0.0), (fill(2 * mean - 1), fill(4 * spread - 1))


def _root(square: Raster) -> Raster:
    return jnp.sqrt(jnp.maximum(square, 0.0))


def _over(value: Raster, size: int) -> Raster:
    """Sums over squares of so many cells to a side; nothing lies beyond the raster."""
    half = size // 2
    for axis in (value.ndim - 2, value.ndim - 1):
        padded = jnp.pad(value, [(half, half) if i == axis else (0, 0) for i in range(value.ndim)])
        parts = [jax.lax.slice_in_dim(padded, k, k + value.shape[axis], axis=axis) for k in range(size)]
        value = sum(parts[1:], parts[0])
    return value


def _line(value: Raster, step: int) -> Raster:
    """What the line `step` below sees; beyond the window its outermost line."""
    rows = np.clip(np.arange(value.shape[-2]) + step, 0, value.shape[-2] - 1)
    return value[..., rows, :]
