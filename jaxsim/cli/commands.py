"""How a row of a command table becomes a running command."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from inspect import getdoc
from typing import Any, NamedTuple

from jaxsim.cli.common import enable_compilation_cache


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
        module, name = self.home.split(":")
        return getattr(importlib.import_module(f"jaxsim.cli.{module}"), name)


def overview(commands: Mapping[str, Command]) -> str:
    """The text of `jaxsim --help`: a line a command."""
    width = max(map(len, commands)) + 2
    lines = "\n".join(f"  {name:<{width}}{command.summary}" for name, command in commands.items())
    return f"""usage: jaxsim COMMAND [--flags]

Learn an automotive LiDAR from drives, simulate it, find what the simulation lacks.

{lines}

jaxsim COMMAND --help begins with an example; jaxsim --version tells the version."""


def choose(name: str, commands: Mapping[str, Command]) -> Command:
    """The command of a name. Raises ValueError with the nearest name and all known ones where there is none."""
    if name in commands:
        return commands[name]
    near = get_close_matches(name, commands, n=1)
    guess = f"; did you mean {near[0]}?" if near else ""
    raise ValueError(f"jaxsim: no command {name!r}{guess} Known commands: {', '.join(commands)}")


def call(command: Command, words: Sequence[str], *, name: str) -> None:
    """Runs a command on the words that follow its name; `name` is how the user called it."""
    entry = command.load()
    enable_compilation_cache()
    if isinstance(entry, type):
        parse(entry, words, name=name, example=command.example)()
    else:
        entry(list(words))


def parse(flags: Any, words: Sequence[str], *, name: str, example: str, more: str = "") -> Any:
    """A dataclass of flags from words; `--help` prints the example, what the dataclass says of itself, and `more`."""
    import tyro  # waits until a command is known, so that `jaxsim --help` answers at once

    from jaxsim.cli.source import in_new_spelling

    said = "\n\n".join(part for part in (f"    {example}", getdoc(flags) or "", more) if part)
    return tyro.cli(flags, args=in_new_spelling(words, flags), prog=name, description=said)
