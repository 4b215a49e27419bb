"""What the table of commands says of one."""

from __future__ import annotations

import importlib
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
