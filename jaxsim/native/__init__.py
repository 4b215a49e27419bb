"""What XLA does slowly on a CPU, in C++, which it calls: compiled on first use, kept, and never needed.

XLA's own form of each function stays that of every other device, of float64, and of a CPU without a C++ compiler, and
it is what the C++ is tested against. `build.form` says which is taken; JAXSIM_NATIVE=0 keeps XLA's. Programs choose
when they are traced.

build                                          compiles, keeps and loads it
all.cc, of convolve.cc, tables.cc, query.cc    for `detect.sparse` and `detect.roi_head`
    patches.cc                                 for `prepare.denoise.lidia.patches`
    tasks.h                                    what they share
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap
from jax.experimental.custom_partitioning import custom_partitioning
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxsim.frame import Array
from jaxsim.native.build import available


def takes(*operands: Array) -> bool:
    """Whether a function of these arrays takes the C++ form when it is traced now."""
    return all(one.dtype in (np.float32, np.int32) for one in operands) and available()


def call(name: str, result: Any, *operands: Array, **attributes: Any) -> Any:
    """The answer of the C++ function of this name for a sample.

    Under vmap that for a batch, of which every device answers the part that it holds.
    """
    target = jax.ffi.ffi_call(f"jaxsim_{name}", result, vmap_method="broadcast_all")
    call = partial(target, **{name: _attribute(value) for name, value in attributes.items()})
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


def _attribute(value: Any) -> Any:
    """Numbers have the types that the C++ side names."""
    if isinstance(value, int):
        return np.int64(value)
    return np.float32(value) if isinstance(value, float) else value


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


def floats(*shape: int) -> jax.ShapeDtypeStruct:
    """Shape and type of a result."""
    return jax.ShapeDtypeStruct(shape, np.float32)


def integers(*shape: int) -> jax.ShapeDtypeStruct:
    """Shape and type of a result."""
    return jax.ShapeDtypeStruct(shape, np.int32)
