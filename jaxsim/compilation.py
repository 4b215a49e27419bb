"""Programs that JAX has compiled, kept on disk for the next process."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


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
    # To note where in the source each operation stands takes much of a short run, and nobody reads it.
    jax.config.update("jax_traceback_in_locations_limit", 0)


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
