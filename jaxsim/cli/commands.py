"""How a row of a command table becomes a running command."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from difflib import get_close_matches
from inspect import getdoc
from pathlib import Path
from typing import Any, NamedTuple

from jaxsim.cli.endings import stop_on_error
from jaxsim.compilation import enable_compilation_cache


class Command(NamedTuple):
    """A row of a command table."""

    home: str
    """`module:name` in jaxsim.cli: a dataclass of flags whose value is called, or a function of the words that
    follow."""
    summary: str
    """One line of `jaxsim --help`."""
    example: str
    """The command line with which the command's own `--help` begins."""

    def load(self) -> Any:
        """What `home` names; its module is imported here and not before."""
        module, _, name = self.home.partition(":")
        return getattr(importlib.import_module(f"jaxsim.cli.{module}"), name)


def overview(commands: Mapping[str, Command]) -> str:
    """The text of `jaxsim --help`: a line a command."""
    width = max(map(len, commands)) + 2
    lines = "\n".join(f"  {name:<{width}}{command.summary}" for name, command in commands.items())
    return f"""usage: jaxsim COMMAND [--flags]

Learn an automotive LiDAR from drives, simulate it, find what the simulation lacks.

{lines}

jaxsim COMMAND --help begins with an example; jaxsim --version tells the version. --quiet, with any command, leaves out
what tells how far it is."""


def find_command(name: str, commands: Mapping[str, Command]) -> Command:
    """The command of a name. Raises ValueError with the nearest name and all known ones where there is none."""
    if name in commands:
        return commands[name]
    near = get_close_matches(name, commands, n=1)
    guess = f"; did you mean {near[0]}?" if near else "."
    raise ValueError(f"jaxsim: no command {name!r}{guess} Known commands: {', '.join(commands)}")


def call(command: Command, words: Sequence[str], *, name: str) -> None:
    """Runs a command on the words that follow its name; `name` is how the user called it.

    The folder that it `writes_to` is kept for it until it ends; where it fails it ends with its `failure`, or 1.
    """
    from jaxsim.files import working_in  # waits until a command is known, as what reads files imports much

    entry = command.load()
    enable_compilation_cache()
    if isinstance(entry, type):
        asked = parse(entry, words, name=name, example=command.example)
        folder: Path | None = getattr(asked, "writes_to", None)
        with stop_on_error(getattr(asked, "failure", 1)), working_in(folder) if folder else nullcontext():
            asked()
    else:
        entry(words)


def parse(flags: Any, words: Sequence[str], *, name: str, example: str) -> Any:
    """A dataclass of flags from words; `--help` prints the example, then what the dataclass says of itself."""
    import tyro  # waits until a command is known, so that `jaxsim --help` answers at once

    from jaxsim.cli.spellings import in_new_spelling

    description = f"    {example}\n\n{getdoc(flags) or ''}"
    return tyro.cli(flags, args=in_new_spelling(words, flags), prog=name, description=description)
