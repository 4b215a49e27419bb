"""Programs that JAX has compiled, kept on disk for the next process; and such as run once."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any


def enable_compilation_cache() -> None:
    """Keeps compiled programs on disk, so that the second run starts at once.

    JAX_COMPILATION_CACHE_DIR chooses the folder; an empty one turns it off.
    """
    import jax

    folder = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if folder is None:
        folder = cache_folder()
    if folder:
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)
        _keep_whole_ones()
    # To note where in the source each operation stands takes much of a short run, and nobody reads it.
    jax.config.update("jax_traceback_in_locations_limit", 0)


@cache
def _keep_whole_ones() -> None:
    """Has JAX keep no program that a full disk cut off: it writes none over such a one, so that every later process
    would warn of it and compile anew. Where a later JAX writes in another way, it is left to it."""
    from jax._src import lru_cache  # it has no public name

    put = getattr(getattr(lru_cache, "LRUCache", None), "put", None)
    suffix = getattr(lru_cache, "_CACHE_SUFFIX", None)
    if put is None or suffix is None:
        return

    @wraps(put)
    def put_whole(self: Any, key: str, value: bytes) -> None:
        try:
            put(self, key, value)
        except OSError:
            (Path(self.path) / f"{key}{suffix}").unlink(missing_ok=True)
            raise

    lru_cache.LRUCache.put = put_whole


def cache_folder(kind: str = "xla") -> Path | None:
    """Where compiled programs of a kind are kept by default; None where this user has no folder to write to.

    A container often runs as a user without a name, without a home, or with one that is read-only. What would lie in
    a folder that all users share might be another's program.
    """
    try:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        folder = Path(home) / "jaxsim" / kind
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (RuntimeError, OSError):
        return None
    return folder


@cache
def compiled_to_run_once(function: Callable[..., Any], static_argnums: tuple[int, ...]) -> Callable[..., Any]:
    """The jitted function, of a program that a process runs once or twice: on a CPU, LLVM would work on it several
    times as long as is saved."""
    import jax

    options = {"xla_backend_optimization_level": 0} if jax.default_backend() == "cpu" else None
    return jax.jit(function, static_argnums=static_argnums, compiler_options=options)
