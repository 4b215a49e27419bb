"""Compilation for programs that run once or twice, on which LLVM works far longer than they run."""

from functools import partial

import jax

quick_jit = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
