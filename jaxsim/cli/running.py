"""How the words of a command line become a running command."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from difflib import get_close_matches
from inspect import getdoc
from itertools import pairwise
from pathlib import Path
from typing import Any

from jaxsim.cli.command import Command
from jaxsim.cli.commands import COMMANDS, MODES
from jaxsim.cli.endings import stop_on_error
from jaxsim.compilation import enable_compilation_cache


def overview() -> str:
    """The text of `jaxsim --help`: a line a command."""
    width = max(map(len, COMMANDS)) + 2
    lines = "\n".join(f"  {name:<{width}}{command.summary}" for name, command in COMMANDS.items())
    return f"""usage: jaxsim COMMAND [--flags]

Learn an automotive LiDAR from drives, simulate it, find what the simulation lacks.

{lines}

jaxsim COMMAND --help begins with an example; jaxsim --version tells the version. --quiet, with any command, leaves out
what tells how far it is."""


def find_command(name: str) -> Command:
    """The command of a name. Raises ValueError with the nearest name and all known ones where there is none."""
    if name in COMMANDS:
        return COMMANDS[name]
    from jaxsim.files import guess  # waits, as what reads files imports much

    raise ValueError(f"jaxsim: no command {name!r}{guess(name, COMMANDS)} Known commands: {', '.join(COMMANDS)}")


def check_mode(words: Sequence[str]) -> None:
    """Raises ValueError where a second word that is no file is nearly that of a command of two: `eval generatoin` would
    be the run of that name. And for an `--out` of nothing, which would be the folder that one stands in."""
    if ("--out", "") in pairwise(words):
        raise ValueError("jaxsim: --out is empty, as of a shell's variable that is not set; name where to write")
    near = get_close_matches(" ".join(words[:2]), MODES, n=1, cutoff=0.9)
    if near and len(words) > 1 and near[0].startswith(f"{words[0]} ") and not Path(words[1]).exists():
        raise ValueError(f"jaxsim: there is no {words[1]}; did you mean jaxsim {near[0]}?")


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
