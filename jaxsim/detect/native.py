"""Sparse convolution, its neighbour search and the query of sites around points in C++, which XLA calls on a CPU.

XLA's own form, in `detect.sparse` and `detect.roi_head`, takes several times as long there. It stays the form of every
other device, of float64, and of a CPU without a C++ compiler, and it is what this one is tested against (`native.takes`
says which is taken).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxsim.frame import Array
from jaxsim.native import call, floats, integers

Triple = tuple[int, int, int]
"""Numbers of z, y, x."""
Numbers = dict[str, Int[np.ndarray, "3"]]
"""`shape` and `out_shape` of the grids, `kernel`, `stride` and `padding`: numbers of z, y, x."""


def convolve(
    features: Float[Array, "n c"], cells: Float[Array, "k c d"], table: Int[Array, "m k"]
) -> Float[Array, "m d"]:
    """For each output the sum over kernel cells of the row that the table names, times the cell's weights."""
    return call("convolve", floats(len(table), cells.shape[-1]), features, cells, table)


def weight_gradient(
    features: Float[Array, "n c"], change: Float[Array, "m d"], table: Int[Array, "m k"]
) -> Float[Array, "k c d"]:
    """Gradient of `convolve` for its weights, at this change of its outputs."""
    shape = floats(table.shape[1], features.shape[1], change.shape[1])
    return call("weight_gradient", shape, features, change, table)


def other_side(table: Int[Array, "m k"], n: int) -> Int[Array, "n k"]:
    """For each of n inputs and each kernel cell the output that sees it; m where there is none."""
    return call("other_side", integers(n, table.shape[1]), table)


def neighbours(inputs: Int[Array, " n"], outputs: Int[Array, " m"], numbers: Numbers) -> Int[Array, "m k"]:
    """`sparse.neighbours` of these keys."""
    shape = integers(len(outputs), int(np.prod(numbers["kernel"])))
    return call("neighbours", shape, inputs, outputs, **numbers)


def strided_sites(
    inputs: Int[Array, " n"], capacity: int, numbers: Numbers
) -> tuple[Int[Array, " capacity"], Int[Array, ""]]:
    """Keys of `sparse.strided_sites`, and how many did not fit."""
    return call("strided_sites", (integers(capacity), integers()), inputs, **numbers)


class Around(NamedTuple):
    """Which cells a query looks at, and what is near."""

    lines: Int[np.ndarray, "k 2"]
    """dz and dy of the lines of cells, in their order."""
    reach: int
    """Cells to either side along them."""
    radius_m: float
    size_m: tuple[float, ...]
    """Of a cell, x, y, z."""
    low_m: tuple[float, ...]
    """The grid's corner."""


def query(
    sites: tuple[Int[Array, " n"], Triple],
    xyz: Float[Array, "q 3"],
    cell: Int[Array, "q 3"],
    *,
    samples: int,
    at: Around,
) -> tuple[Int[Array, "q s"], Int[Array, " q"]]:
    """Rows of the first `samples` sites (keys and grid) around points in cells (z, y, x), and how many there are.

    Where there are fewer, the first stands again; where there is none, 0.
    """
    keys, shape = sites
    attributes = {
        "shape": np.array(shape, np.int64),
        "lines": at.lines.astype(np.int64).reshape(-1),
        "reach": at.reach,
        "radius_squared": float(at.radius_m**2),
        "size": np.array(at.size_m, np.float32),
        "corner": np.array(at.low_m, np.float32),
    }
    shapes = integers(len(xyz), samples), integers(len(xyz))
    return call("query", shapes, keys, jax.lax.stop_gradient(xyz), cell, **attributes)
