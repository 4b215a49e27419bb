"""What all command lines share."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import tyro
from pydantic import TypeAdapter, ValidationError

from jaxsim.config import DetectorExperiment, Experiment


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


def parse_experiment(configs: Any, argv: list[str]) -> tuple[Any, str]:
    """The experiment that a command line asks for, and its docstring.

    `argv` is an optional name of `configs`, or the config.json of a run, then flags over its fields.
    """
    name, flags = (argv[0], argv[1:]) if argv and not argv[0].startswith("-") else ("synthetic", argv)
    if name.endswith(".json"):
        experiment, docstring = read_experiment(Path(name)), f"Settings of {name}."
    else:
        experiment, docstring = configs.load(name)
    width = max(map(len, configs.NAMES)) + 2
    others = "\n".join(f"  {n:<{width}}{configs.load(n)[1].splitlines()[0]}" for n in configs.NAMES)
    intro = f"""python train.py [EXPERIMENT] [--flags]; the same command again resumes the run.

Experiments (configs/):
{others}

{name}: {docstring}"""
    default = replace(experiment, run=replace(experiment.run, name=experiment.run.name or name))
    parsed = tyro.cli(type(experiment), args=flags, default=default, description=intro, prog=f"train.py {name}")
    return parsed, docstring


def read_experiment(path: Path) -> Any:
    """The experiment in a run's config.json. Raises ValueError where the file holds none of this version."""
    from jaxsim.config import DepthExperiment

    try:
        content = json.loads(path.read_text())
        # Depth completion's runs hold nothing beside it.
        content = content if "penet" in content else content["experiment"]
        kinds = {"detector": DetectorExperiment, "penet": DepthExperiment}
        kind = next((kind for part, kind in kinds.items() if part in content), Experiment)
        return TypeAdapter(kind).validate_python(content)
    except FileNotFoundError:
        raise ValueError(f"no file {path}; give an experiment of configs/, or the config.json of a run") from None
    except (ValueError, KeyError, TypeError, ValidationError) as error:
        raise ValueError(f"{path} is not the config.json of a run of this version: {error}") from error
