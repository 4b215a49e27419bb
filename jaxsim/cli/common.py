"""What all command lines share."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def enable_compilation_cache() -> None:
    """Keeps compiled programs on disk, so that the second run starts at once.

    JAX_COMPILATION_CACHE_DIR chooses the folder; an empty one turns it off.
    """
    import jax

    default = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "jaxsim" / "xla"
    folder = os.environ.get("JAX_COMPILATION_CACHE_DIR", str(default))
    if folder:
        jax.config.update("jax_compilation_cache_dir", folder)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)


@contextmanager
def stop_on_error() -> Iterator[None]:
    """Ends the program with the message alone where a user can mend the cause, and quietly where nobody reads on
    (`| head`).

    JAXSIM_TRACEBACK=1 shows where it came from.
    """
    try:
        yield
    except BrokenPipeError:
        # Python flushes once more at its end: into nothing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)  # what shells call a closed pipe
    except (ValueError, FileNotFoundError, ModuleNotFoundError) as error:
        if os.environ.get("JAXSIM_TRACEBACK"):
            raise
        sys.exit(f"error: {error}")
