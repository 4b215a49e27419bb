"""`jaxsim train`, which `python train.py` is too: trains an experiment, or resumes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import tyro

from jaxsim.runs.kinds import AnyExperiment
from jaxsim.train import experiment_names, load_experiment, train

DEFAULT = "synthetic"


def run(argv: Sequence[str]) -> None:
    """Trains an intensity network, a detector or depth completion; the same command resumes it.

    `argv` is an experiment (one of configs/, a file like them, or the config.json of a run; by default the embedded
    world) and flags, which are its settings.
    """
    train(*parse_experiment(argv))


def parse_experiment(argv: Sequence[str]) -> tuple[AnyExperiment, str]:
    """The experiment that a command line asks for, and its docstring."""
    named = bool(argv) and not argv[0].startswith("-")
    name, flags = (argv[0], argv[1:]) if named else (DEFAULT, argv)
    experiment, docstring = load_experiment(name)
    names = experiment_names()
    width = max(map(len, names)) + 2
    others = "\n".join(f"  {n:<{width}}{load_experiment(n)[1].splitlines()[0]}" for n in names)
    intro = f"""    jaxsim train {name}

Trains the experiment; the same command again resumes the run.

Experiments (configs/):
{others}

{name}: {docstring}"""
    folder = name.rsplit("/", 1)[-1].removesuffix(".py")
    default = replace(experiment, run=replace(experiment.run, name=experiment.run.name or folder))
    parsed = tyro.cli(type(experiment), args=flags, default=default, description=intro, prog=f"jaxsim train {name}")
    return parsed, docstring
