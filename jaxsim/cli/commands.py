"""How a row of a command table becomes a running command, and what all command lines share."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from inspect import getdoc
from pathlib import Path
from typing import Any, NamedTuple


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

jaxsim COMMAND --help begins with an example; jaxsim --version tells the version."""


def choose(name: str, commands: Mapping[str, Command]) -> Command:
    """The command of a name. Raises ValueError with the nearest name and all known ones where there is none."""
    if name in commands:
        return commands[name]
    near = get_close_matches(name, commands, n=1)
    guess = f"; did you mean {near[0]}?" if near else "."
    raise ValueError(f"jaxsim: no command {name!r}{guess} Known commands: {', '.join(commands)}")


def call(command: Command, words: Sequence[str], *, name: str) -> None:
    """Runs a command on the words that follow its name; `name` is how the user called it."""
    entry = command.load()
    enable_compilation_cache()
    if isinstance(entry, type):
        parse(entry, words, name=name, example=command.example)()
    else:
        entry(words)


def parse(flags: Any, words: Sequence[str], *, name: str, example: str) -> Any:
    """A dataclass of flags from words; `--help` prints the example, then what the dataclass says of itself."""
    import tyro  # waits until a command is known, so that `jaxsim --help` answers at once

    from jaxsim.cli.source import in_new_spelling

    description = f"    {example}\n\n{getdoc(flags) or ''}"
    return tyro.cli(flags, args=in_new_spelling(words, flags), prog=name, description=description)


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
