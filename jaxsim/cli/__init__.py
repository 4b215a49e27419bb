"""`jaxsim COMMAND`: the commands of the console script."""

from __future__ import annotations

import sys

import tyro

from jaxsim.cli import train
from jaxsim.cli.common import enable_compilation_cache, stop_on_error
from jaxsim.cli.convert import Convert
from jaxsim.cli.detect import Detect
from jaxsim.cli.discover import Discover
from jaxsim.cli.effects import Effects
from jaxsim.cli.export import Export
from jaxsim.cli.prepare import Prepare
from jaxsim.cli.real2sim2real import Real2Sim2Real, run
from jaxsim.cli.simulate import Simulate

__all__ = ["COMMANDS", "enable_compilation_cache", "main", "stop_on_error"]

COMMANDS = {
    "train": train.Train,
    "prepare": Prepare,
    "simulate": Simulate,
    "export": Export,
    "detect": Detect,
    "real2sim2real": Real2Sim2Real,
    "discover": Discover,
    "effects": Effects,
    "convert": Convert,
}
"""Every command: its name and what it takes."""


def main(argv: list[str] | None = None) -> None:
    """Entry point of the console script."""
    enable_compilation_cache()
    argv = sys.argv[1:] if argv is None else argv
    with stop_on_error():
        if argv[:1] == ["train"]:  # its flags are the fields of the experiment that it names
            return train.run(argv[1:])
        if argv[:1] == ["real2sim2real"]:  # its flags are the fields of the experiment that --config names
            return run(argv[1:])
        tyro.extras.subcommand_cli_from_dict(COMMANDS, args=argv, prog="jaxsim", description=__doc__)()
