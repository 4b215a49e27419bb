"""The C++ form: compiled on first use for the processor at hand, kept, and handed to XLA.

What is kept has a name of all that it depends on: a home folder may be shared by machines of several kinds, and an
instruction that one of them lacks would end the program.
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
from importlib.metadata import version
from pathlib import Path

import jax

from jaxsim.compilation import cache_folder

_log = logging.getLogger(__name__)

SOURCE = Path(__file__).with_name("all.cc")
SETTING = "JAXSIM_NATIVE"
COMPILERS = ("c++", "g++", "clang++")
FLAGS = ("-O3", "-std=c++17", "-shared", "-fPIC")
FUNCTIONS = ("convolve", "weight_gradient", "neighbours", "other_side", "strided_sites", "query", "nearest_patches")
LONGEST_S = 300
"""Seconds after which a compiler counts as hanging."""


def available() -> bool:
    """Whether functions traced now take the C++ form; compiles it where that has not been done."""
    return form().startswith("C++")


def form() -> str:
    """Which form functions traced now take: `C++` with its file, or `XLA` with the reason."""
    if os.environ.get(SETTING) == "0":
        return f"XLA ({SETTING}=0)"
    backend = jax.default_backend()
    return _loaded() if backend == "cpu" else f"XLA (for {backend})"


@cache
def _loaded() -> str:
    """The form on a CPU, made ready; says so once where it is not C++."""
    try:
        library = build()
        functions = ctypes.CDLL(str(library))
        for name in FUNCTIONS:
            target = f"jaxsim_{name}"
            jax.ffi.register_ffi_target(target, jax.ffi.pycapsule(getattr(functions, target)), platform="cpu")
    except (OSError, AttributeError, subprocess.SubprocessError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        _log.warning(f"native: no C++ form ({reason}); XLA's form is taken, which takes several times as long")
        return f"XLA ({reason})"
    return f"C++ ({library})"


def build() -> Path:
    """The library for this machine, compiled if it is not kept.

    Raises FileNotFoundError where there is no compiler or no folder to keep it in, OSError where compilation fails.
    """
    compiler = find_compiler()
    folder = cache_folder("native")
    if folder is None:
        raise FileNotFoundError("no folder that this user may write to; set XDG_CACHE_HOME to one")
    library = folder / f"{name_of(compiler)}.so"
    if library.is_file():
        return library
    _log.info(f"native: compiling the C++ form for this processor with {compiler}, once")
    with tempfile.TemporaryDirectory(dir=folder) as work:
        made = Path(work) / library.name
        command = [compiler, *FLAGS, "-isystem", jax.ffi.include_dir(), str(SOURCE), "-o", str(made)]
        run = _run([*command, "-march=native"])
        if run.returncode:
            run = _run(command)  # not every compiler knows every processor
        if run.returncode:
            said = run.stderr.splitlines() or ["without a word"]
            raise OSError(f"{compiler} fails: {next((line for line in said if 'error' in line), said[0])}")
        made.replace(library)  # at once: another process finds all of it or nothing
    return library


def find_compiler() -> str:
    """The compiler that CXX names, or the first of the usual ones. Raises FileNotFoundError where there is none."""
    named = os.environ.get("CXX")
    for name in (named,) if named else COMPILERS:
        found = shutil.which(name)
        if found:
            return found
    raise FileNotFoundError(f"no C++ compiler: {f'{named} (CXX)' if named else ', '.join(COMPILERS)} not found")


def name_of(compiler: str) -> str:
    """A name of all that the library depends on: sources, XLA's headers, compiler, flags, what the processor knows."""
    sources = [path.read_text() for path in sorted(SOURCE.parent.iterdir()) if path.suffix in (".cc", ".h")]
    parts = [*sources, version("jaxlib"), _run([compiler, "--version"]).stdout, *FLAGS, *_processor()]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, stdin=subprocess.DEVNULL)


def _processor() -> list[str]:
    """Kind and abilities of the processor."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    known = {line for line in lines if line.startswith(("flags", "Features", "model", "CPU part"))}
    return [platform.system(), platform.machine(), platform.processor(), *sorted(known)]
