"""`jaxsim train`, which `python train.py` is too: trains an experiment, or resumes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import tyro

from jaxsim.train.experiments import AnyExperiment, experiment_names, load_experiment


@dataclass(frozen=True)
class Train:
    """Trains an intensity network, a detector or depth completion; the same command resumes it.

        jaxsim train kitti_raw --data.root KITTI_RAW

    The run goes to runs/NAME. Any setting of the experiment is a flag: `jaxsim train NAME --help` lists them.
    """

    experiment: Annotated[str, tyro.conf.Positional] = "synthetic"
    """One of configs/, a file like them (my_experiment.py), or the config.json of a run."""

    def __call__(self) -> None:
        run([self.experiment])


def run(argv: Sequence[str]) -> None:
    """Runs the command on an optional name and flags, the settings of that experiment."""
    from jaxsim.train.loop import train

    train(*parse_experiment(argv))


def parse_experiment(argv: Sequence[str]) -> tuple[AnyExperiment, str]:
    """The experiment that a command line asks for, and its docstring."""
    named = bool(argv) and not argv[0].startswith("-")
    name, flags = (argv[0], argv[1:]) if named else (Train.experiment, argv)
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
