"""Sparse 3D convolution with static shapes: sorted keys, neighbour tables, gather and matrix product.

Letters: n sites of the input, m of the output, k cells of the kernel, c channels in, d out. A grid is (z, y, x). A
site's key is (z Y + y) X + x; keys rise, and the places that a sample does not use come last, with a key past the
grid's last cell. A table holds rows of the other side; one past the last row means that there is no site.

A table is built once a stage and has no gradient. Every pass, forward and backward, gathers rows and multiplies:
no feature is scattered, and no dense volume is made.

XLA's form of it takes several times as long on a CPU as one in C++, which it calls where `jaxsim.native` takes it, with
the same answers but for rounding.
"""

from __future__ import annotations

from itertools import product
from math import prod
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array
from jaxsim.native import call, floats, integers, takes

Triple = tuple[int, int, int]
"""Numbers of z, y, x."""
CUBE: Triple = (3, 3, 3)


class ConvWindow(NamedTuple):
    """What an output of a convolution sees of its input."""

    kernel: Triple
    stride: Triple
    padding: Triple


@struct.dataclass
class Sites:
    """Active cells of a sample's grid, each once; or of a batch of samples."""

    key: Array
    """int32 (*b, n): rising."""
    shape: Triple = struct.field(pytree_node=False)
    """Cells of the grid along z, y, x."""

    @property
    def valid(self) -> Bool[Array, "*b n"]:
        """Whether each row holds a site, for places without one have a key behind all."""
        return self.key < cells(self.shape)

    @property
    def zyx(self) -> Int[Array, "*b n 3"]:
        """Places in the grid; of unused places they mean nothing."""
        _, rows, columns = self.shape
        return jnp.stack([self.key // (rows * columns), self.key // columns % rows, self.key % columns], axis=-1)


@struct.dataclass
class Tables:
    """Who sees whom in one convolution."""

    forward: Array
    """int32 (m, k): for each output and kernel cell the input's row; n: none."""
    backward: Array
    """int32 (n, k): for each input and kernel cell the output's row that it adds to; m: none."""


def cells(shape: Triple) -> int:
    """Cells of a grid. Raises ValueError where their keys do not fit 32 bits."""
    count = shape[0] * shape[1] * shape[2]
    if count >= 2**31 - 1:
        raise ValueError(
            f"sparse: a grid of {shape} cells has keys beyond 32 bits; use larger voxels or a shorter range"
        )
    return count


def key_of(zyx: Int[Array, "*n 3"], shape: Triple) -> Int[Array, "*n"]:
    """Keys of places inside the grid."""
    return (zyx[..., 0] * shape[1] + zyx[..., 1]) * shape[2] + zyx[..., 2]


def strided_shape(shape: Triple, window: ConvWindow) -> Triple:
    """Grid of a strided convolution's output."""

    def along(axis: int) -> int:
        return (shape[axis] + 2 * window.padding[axis] - window.kernel[axis]) // window.stride[axis] + 1

    return along(0), along(1), along(2)


def unique_sites(keys: Int[Array, " q"], shape: Triple, capacity: int) -> tuple[Sites, Int[Array, ""]]:
    """The different keys among these, rising, and how many did not fit: those beyond `capacity` are left out."""
    outside = cells(shape)
    keys = jnp.sort(jnp.minimum(keys, outside))
    # Sorted, equal keys stand together: a key is new where it differs from the one before.
    new = (keys < outside) & jnp.concatenate([jnp.ones(1, bool), keys[1:] != keys[:-1]])
    slot = jnp.cumsum(new, dtype=jnp.int32) - 1
    unique = jnp.full(capacity, outside, jnp.int32).at[jnp.where(new, slot, capacity)].set(keys, mode="drop")
    return Sites(unique, shape), jnp.maximum(new.sum(dtype=jnp.int32) - capacity, 0)


def strided_sites(sites: Sites, window: ConvWindow, capacity: int) -> tuple[Sites, Int[Array, ""]]:
    """Outputs that have an active input in their kernel, and how many of them did not fit `capacity`."""
    kernel, stride, padding = window
    shape = strided_shape(sites.shape, window)
    if takes(sites.key):
        key, dropped = call(
            "strided_sites", (integers(capacity), integers()), sites.key, **_numbers(sites.shape, shape, window)
        )
        return Sites(key, shape), dropped
    zyx, valid = sites.zyx, sites.valid
    # Input i is seen by outputs o with o t - p <= i < o t - p + k: along each axis the last such o and those below it.
    reach = [-(-k // t) for k, t in zip(kernel, stride, strict=True)]
    keys = []
    for back in product(*map(range, reach)):
        inside, out = valid, []
        for axis, b in enumerate(back):
            o = (zyx[:, axis] + padding[axis]) // stride[axis] - b
            seen = zyx[:, axis] + padding[axis] - o * stride[axis] < kernel[axis]
            inside &= (o >= 0) & (o < shape[axis]) & seen
            out.append(o)
        keys.append(jnp.where(inside, key_of(jnp.stack(out, axis=-1), shape), cells(shape)))
    return unique_sites(jnp.concatenate(keys), shape, capacity)


def neighbours(inputs: Sites, outputs: Sites, window: ConvWindow) -> Int[Array, "m k"]:
    """For each output and kernel cell (z slowest) the row of the input below it; n where there is none."""
    if takes(inputs.key, outputs.key):
        table = integers(len(outputs.key), prod(window.kernel))
        numbers = _numbers(inputs.shape, outputs.shape, window)
        return call("neighbours", table, inputs.key, outputs.key, **numbers)
    kernel, stride, padding = window
    n, (planes, rows, columns) = len(inputs.key), inputs.shape
    corner = outputs.zyx * jnp.array([stride]) - jnp.array([padding])
    dz, dy = jnp.repeat(jnp.arange(kernel[0]), kernel[1]), jnp.tile(jnp.arange(kernel[1]), kernel[0])
    z = corner[:, :1] + dz[None]
    y = corner[:, 1:2] + dy[None]
    x = corner[:, 2:]
    row_inside = outputs.valid[:, None] & (z >= 0) & (z < planes) & (y >= 0) & (y < rows)
    start = jnp.where(row_inside, (z * rows + y) * columns, 0)
    # One search a kernel row: the cells along x have neighbouring keys, so their sites follow one another.
    at = jnp.searchsorted(inputs.key, start + jnp.maximum(x, 0)).astype(jnp.int32)
    table = []
    for dx in range(kernel[2]):
        here = inputs.key.at[at].get(mode="fill", fill_value=-1)
        occupied = row_inside & (x + dx >= 0) & (x + dx < columns) & (here == start + x + dx)
        table.append(jnp.where(occupied, at, n))
        at = at + occupied.astype(jnp.int32)
    return jnp.stack(table, axis=-1).reshape(len(outputs.key), -1)


def _numbers(shape: Triple, out_shape: Triple, window: ConvWindow) -> dict[str, Int[np.ndarray, "3"]]:
    """What the C++ is told of a convolution: numbers of z, y, x."""
    numbers = {"shape": shape, "out_shape": out_shape, **window._asdict()}
    return {name: np.array(three, np.int64) for name, three in numbers.items()}


def submanifold_tables(sites: Sites) -> Tables:
    """Tables of a convolution with a kernel of 3 x 3 x 3 whose outputs are its inputs' sites."""
    forward = neighbours(sites, sites, ConvWindow(CUBE, (1, 1, 1), (1, 1, 1)))
    return Tables(forward, forward[:, ::-1])  # who sees a site through one cell is seen by it through the opposite one


def strided_tables(inputs: Sites, outputs: Sites, window: ConvWindow) -> Tables:
    """Tables of a convolution from `inputs` to the sites that `strided_sites` gave."""
    forward = neighbours(inputs, outputs, window)
    m, k = forward.shape
    if takes(forward):
        return Tables(forward, call("other_side", integers(len(inputs.key), k), forward))
    rows, columns = jnp.arange(m, dtype=jnp.int32)[:, None], jnp.arange(k, dtype=jnp.int32)[None]
    backward = jnp.full((len(inputs.key), k), m, jnp.int32).at[forward, columns].set(rows, mode="drop")
    return Tables(forward, backward)


@jax.custom_vjp
def sparse_conv(
    features: Float[Array, "n c"], kernel: Float[Array, "kz ky kx c d"], tables: Tables
) -> Float[Array, "m d"]:
    """Cross-correlation of the inputs' features with the kernel, at the outputs' sites."""
    return _gather_and_multiply(features, _cells_of(kernel), tables.forward)


def _gather_and_multiply(
    features: Float[Array, "n c"], cells: Float[Array, "k c d"], table: Int[Array, "m k"]
) -> Float[Array, "m d"]:
    if takes(features, cells, table):
        return call("convolve", floats(len(table), cells.shape[-1]), features, cells, table)

    # One kernel cell after another: side by side the gathered rows of all cells would fill the memory.
    def add(total, cell):
        row, weights = cell
        return total + _rows(features, row) @ weights, None

    start = jnp.zeros((len(table), cells.shape[-1]), features.dtype)
    return jax.lax.scan(add, start, (table.T, cells))[0]


def _rows(features: Float[Array, "n c"], row: Int[Array, " m"]) -> Float[Array, "m c"]:
    """Rows of the features, 0 where there is none."""
    return features.at[row].get(mode="fill", fill_value=0)


def _cells_of(kernel: Float[Array, "kz ky kx c d"]) -> Float[Array, "k c d"]:
    return kernel.reshape(-1, *kernel.shape[-2:])


def _backward(kept, change):
    features, kernel, tables = kept
    # Inputs gather from the outputs that they add to, by the backward table: a scatter would sum in no fixed order.
    of_features = _gather_and_multiply(change, _cells_of(kernel).transpose(0, 2, 1), tables.backward)
    return of_features, _weight_gradient(features, change, tables.forward).reshape(kernel.shape), None


def _weight_gradient(
    features: Float[Array, "n c"], change: Float[Array, "m d"], table: Int[Array, "m k"]
) -> Float[Array, "k c d"]:
    if takes(features, change, table):
        shape = floats(table.shape[1], features.shape[1], change.shape[1])
        return call("weight_gradient", shape, features, change, table)
    return jax.lax.map(lambda row: _rows(features, row).T @ change, table.T)


sparse_conv.defvjp(lambda *given: (sparse_conv(*given), given), _backward)
