"""Sparse convolution and its neighbour search in C++ (native.cc), which XLA calls on a CPU; float32.

XLA's own form, in sparse.py, takes three times as long and more there. It stays the form of every other device and
type, and of a CPU without a C++ compiler: nothing needs this file. The source is compiled on first use, which takes some
seconds and is logged, for the processor at hand, and kept in the user's cache (`~/.cache/jaxsim/native`) under a name
of all that it depends on: another machine, jaxlib or compiler makes its own.

JAXSIM_NATIVE=0 keeps XLA's form. Programs choose when they are traced.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import jax
import jaxlib
import numpy as np
from jaxtyping import Float, Int

from jaxsim.compilation import cache_folder
from jaxsim.frame import Array

_log = logging.getLogger(__name__)

SOURCE = Path(__file__).with_name("native.cc")
SETTING = "JAXSIM_NATIVE"
COMPILERS = ("c++", "g++", "clang++")
FLAGS = ("-O3", "-std=c++17", "-shared", "-fPIC")
FUNCTIONS = ("convolve", "weight_gradient", "neighbours", "other_side", "strided_sites")
LONGEST_S = 300
"""Seconds after which a compiler counts as hanging."""


def available() -> bool:
    """Whether functions traced now take the C++ form; compiles it where that has not been done."""
    return form().startswith("C++")


def form() -> str:
    """Which form functions traced now take, `C++` or `XLA`, and why or of which file."""
    if os.environ.get(SETTING) == "0":
        return f"XLA ({SETTING}=0)"
    backend = jax.default_backend()
    return _loaded() if backend == "cpu" else f"XLA (for {backend})"


@cache
def _loaded() -> str:
    """The form on a CPU, made ready; tells once why it is not C++."""
    try:
        library = build()
        functions = ctypes.CDLL(str(library))
        for name in FUNCTIONS:
            jax.ffi.register_ffi_target(
                f"jaxsim_{name}", jax.ffi.pycapsule(getattr(functions, f"jaxsim_{name}")), platform="cpu"
            )
            # A batch that is cut over devices is answered on each for its part.
            jax.ffi.register_ffi_target_as_batch_partitionable(f"jaxsim_{name}")
    except (OSError, AttributeError, subprocess.SubprocessError) as error:
        reason = str(error).strip().splitlines()[-1]
        _log.warning(f"sparse: no C++ form ({reason}); convolutions take XLA's, which is several times slower")
        return f"XLA ({reason})"
    return f"C++ ({library})"


def build() -> Path:
    """The library for this machine, compiled if it is not kept.

    Raises FileNotFoundError where there is no compiler or no folder to keep it in, OSError where compilation fails.
    """
    compiler = _compiler()
    folder = cache_folder("native")
    if folder is None:
        raise FileNotFoundError("no folder that this user may write to; set XDG_CACHE_HOME to one")
    library = folder / f"{_name(compiler)}.so"
    if library.is_file():
        return library
    _log.info(f"sparse: compiling {SOURCE.name} for this processor with {compiler}, once")
    with tempfile.TemporaryDirectory(dir=folder) as work:
        made = Path(work) / library.name
        command = [compiler, *FLAGS, "-isystem", jax.ffi.include_dir(), str(SOURCE), "-o", str(made)]
        # Not every compiler knows every processor.
        for own in (["-march=native"], []):
            run = subprocess.run([*command, *own], capture_output=True, text=True, timeout=LONGEST_S, stdin=subprocess.DEVNULL)
            if run.returncode == 0:
                made.replace(library)  # at once: another process finds all of it or nothing
                return library
    said = [line for line in run.stderr.splitlines() if "error" in line] or run.stderr.splitlines() or ["silently"]
    raise OSError(f"{compiler} fails: {said[0]}")


def _compiler() -> str:
    """The compiler that CXX names, or the first of the usual ones."""
    named = os.environ.get("CXX")
    for name in (named,) if named else COMPILERS:
        found = shutil.which(name)
        if found:
            return found
    raise FileNotFoundError(f"no C++ compiler: {'CXX=' + named if named else ', '.join(COMPILERS)} not found")


def _name(compiler: str) -> str:
    """A name of all that the library depends on: source, headers, compiler, flags and the processor's abilities."""
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, timeout=LONGEST_S).stdout
    parts = [SOURCE.read_text(), jaxlib.__version__, compiler, version, *FLAGS, *_processor()]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _processor() -> list[str]:
    """Kind and abilities of the processor: a home folder may be shared by machines that differ in them."""
    told = [platform.system(), platform.machine(), platform.processor()]
    file = Path("/proc/cpuinfo")
    lines = file.read_text().splitlines() if file.is_file() else []
    return told + sorted({line for line in lines if line.startswith(("flags", "Features", "model", "CPU part"))})


def convolve(
    features: Float[Array, "n c"], cells: Float[Array, "k c d"], table: Int[Array, "m k"]
) -> Float[Array, "m d"]:
    """For each output the sum over kernel cells of the row that the table names, times the cell's weights."""
    shape = jax.ShapeDtypeStruct((len(table), cells.shape[-1]), np.float32)
    return _call("convolve", shape)(features, cells, table)


def weight_gradient(
    features: Float[Array, "n c"], change: Float[Array, "m d"], table: Int[Array, "m k"]
) -> Float[Array, "k c d"]:
    """Gradient of `convolve` for its weights, at this change of its outputs."""
    shape = jax.ShapeDtypeStruct((table.shape[1], features.shape[1], change.shape[1]), np.float32)
    return _call("weight_gradient", shape)(features, change, table)


def other_side(table: Int[Array, "m k"], n: int) -> Int[Array, "n k"]:
    """For each of n inputs and each kernel cell the output that sees it; m where there is none."""
    return _call("other_side", jax.ShapeDtypeStruct((n, table.shape[1]), np.int32))(table)


Numbers = dict[str, tuple[int, int, int]]
"""Of z, y, x: `shape` and `out_shape` of the grids, `kernel`, `stride` and `padding`."""


def neighbours(inputs: Int[Array, " n"], outputs: Int[Array, " m"], numbers: Numbers) -> Int[Array, "m k"]:
    """`sparse.neighbours` of these keys."""
    shape = jax.ShapeDtypeStruct((len(outputs), int(np.prod(numbers["kernel"]))), np.int32)
    return _call("neighbours", shape)(inputs, outputs, **_attributes(numbers))


def strided_sites(
    inputs: Int[Array, " n"], capacity: int, numbers: Numbers
) -> tuple[Int[Array, " capacity"], Int[Array, ""]]:
    """Keys of `sparse.strided_sites`, and how many did not fit."""
    shapes = jax.ShapeDtypeStruct((capacity,), np.int32), jax.ShapeDtypeStruct((), np.int32)
    return _call("strided_sites", shapes)(inputs, **_attributes(numbers))


def _call(name: str, shapes):
    return jax.ffi.ffi_call(f"jaxsim_{name}", shapes, vmap_method="broadcast_all")


def _attributes(numbers: Numbers) -> dict[str, np.ndarray]:
    return {name: np.array(three, np.int64) for name, three in numbers.items()}
