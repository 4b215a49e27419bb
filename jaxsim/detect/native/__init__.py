"""Sparse convolution, its neighbour search and the query of sites around points in C++, which XLA calls on a CPU.

XLA's own form, in `detect.sparse` and `detect.roi_head`, takes several times as long there. It stays the form of every
other device, of float64, and of a CPU without a C++ compiler, and it is what this one is tested against. `build.form`
says which is taken; JAXSIM_NATIVE=0 keeps XLA's. Programs choose when they are traced.

build                                    compiles, keeps and loads it
all.cc, of convolve.cc, tables.cc, query.cc and tasks.h
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap
from jax.experimental.custom_partitioning import custom_partitioning
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Float, Int

from jaxsim.detect.native.build import available
from jaxsim.frame import Array

Triple = tuple[int, int, int]
"""Numbers of z, y, x."""
Numbers = dict[str, Triple]
"""`shape` and `out_shape` of the grids, `kernel`, `stride` and `padding`."""


def takes(*operands: Array) -> bool:
    """Whether a function of these arrays takes the C++ form when it is traced now."""
    return all(one.dtype in (np.float32, np.int32) for one in operands) and available()


def convolve(
    features: Float[Array, "n c"], cells: Float[Array, "k c d"], table: Int[Array, "m k"]
) -> Float[Array, "m d"]:
    """For each output the sum over kernel cells of the row that the table names, times the cell's weights."""
    return _call("convolve", _floats(len(table), cells.shape[-1]), features, cells, table)


def weight_gradient(
    features: Float[Array, "n c"], change: Float[Array, "m d"], table: Int[Array, "m k"]
) -> Float[Array, "k c d"]:
    """Gradient of `convolve` for its weights, at this change of its outputs."""
    shape = _floats(table.shape[1], features.shape[1], change.shape[1])
    return _call("weight_gradient", shape, features, change, table)


def other_side(table: Int[Array, "m k"], n: int) -> Int[Array, "n k"]:
    """For each of n inputs and each kernel cell the output that sees it; m where there is none."""
    return _call("other_side", _integers(n, table.shape[1]), table)


def neighbours(inputs: Int[Array, " n"], outputs: Int[Array, " m"], numbers: Numbers) -> Int[Array, "m k"]:
    """`sparse.neighbours` of these keys."""
    shape = _integers(len(outputs), int(np.prod(numbers["kernel"])))
    return _call("neighbours", shape, inputs, outputs, **_attributes(numbers))


def strided_sites(
    inputs: Int[Array, " n"], capacity: int, numbers: Numbers
) -> tuple[Int[Array, " capacity"], Int[Array, ""]]:
    """Keys of `sparse.strided_sites`, and how many did not fit."""
    return _call("strided_sites", (_integers(capacity), _integers()), inputs, **_attributes(numbers))


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
        "reach": np.int64(at.reach),
        "radius_squared": np.float32(at.radius_m**2),
        "size": np.array(at.size_m, np.float32),
        "corner": np.array(at.low_m, np.float32),
    }
    shapes = _integers(len(xyz), samples), _integers(len(xyz))
    return _call("query", shapes, keys, jax.lax.stop_gradient(xyz), cell, **attributes)


def _call(name: str, result: Any, *operands: Array, **attributes: Any) -> Any:
    """The answer for a sample; under vmap for a batch, of which every device answers the part that it holds."""
    target = jax.ffi.ffi_call(f"jaxsim_{name}", result, vmap_method="broadcast_all")
    call = partial(target, **attributes)
    given = [operand.ndim for operand in operands], [leaf.ndim for leaf in jax.tree.leaves(result)]
    one, many = custom_vmap(call), custom_vmap(_cut_over_devices(jax.vmap(call), given))
    all_batched = jax.tree.map(lambda _: True, result)

    @one.def_vmap
    def batch(size: int, batched: list[bool], *operands: Array) -> tuple[Any, Any]:
        whole = [
            operand if is_batched else jnp.broadcast_to(operand[None], (size, *operand.shape))
            for operand, is_batched in zip(operands, batched, strict=True)
        ]
        return many(*whole), all_batched

    @many.def_vmap
    def batches(size: int, batched: list[bool], *operands: Array) -> tuple[Any, Any]:
        axes = [0 if is_batched else None for is_batched in batched]
        return jax.vmap(jax.vmap(call), axes)(*operands), all_batched

    return one(*operands)


def _cut_over_devices(many: Callable, ranks: tuple[list[int], list[int]]) -> Callable:
    """A function of batches, by the numbers of dims that samples of its operands and results have."""
    cut = custom_partitioning(many)

    def partition(mesh: Mesh, operands: Any, results: Any) -> tuple[Mesh, Callable, Any, Any]:
        samples = jax.tree.leaves(results)[0].sharding.spec[:1]
        sharding = NamedSharding(mesh, PartitionSpec(*samples))
        return mesh, many, jax.tree.map(lambda _: sharding, results), jax.tree.map(lambda _: sharding, operands)

    # All share the first axis, b, and no other.
    numbers = count()
    sides = [", ".join(" ".join(["b", *(f"i{next(numbers)}" for _ in range(rank))]) for rank in side) for side in ranks]
    cut.def_partition(partition=partition, sharding_rule=" -> ".join(sides))
    return cut


def _floats(*shape: int) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(shape, np.float32)


def _integers(*shape: int) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(shape, np.int32)


def _attributes(numbers: Numbers) -> dict[str, np.ndarray]:
    return {name: np.array(three, np.int64) for name, three in numbers.items()}
