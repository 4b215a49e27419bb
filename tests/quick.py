"""Compilation for programs that run once or twice, on which LLVM works far longer than they run."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import jax

quick_jit = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


@contextmanager
def quickly_compiled() -> Iterator[None]:
    """All that is compiled in this block, in any thread, is compiled so."""
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", True)
    try:
        yield
    finally:
        jax.config.update("jax_disable_most_optimizations", before)
