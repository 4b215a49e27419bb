"""`jaxsim COMMAND`: the commands of the console script.

A command is a row of COMMANDS (or of MODES) and a module of this package. Only the module of the command that is asked
for is imported, so that `jaxsim --help` answers at once; nothing here imports JAX. No commands are `command` and
`commands` (the rows), `running` (how one becomes a running command), `console` (what all tell), `flags` (what several
share), `spellings` (flags of earlier versions), `elsewhere` (a command on a cluster), `endings` (how failures are
told), and of discover `sides`, `naming` and `gates`.
"""

from __future__ import annotations

import atexit
import gc
import sys
from importlib.metadata import version

from jaxsim.cli.commands import COMMANDS, MODES
from jaxsim.cli.console import tell_on_console, without_quiet
from jaxsim.cli.endings import stop_on_error
from jaxsim.cli.running import call, check_mode, find_command, overview
from jaxsim.interrupts import end_with_parent

__all__ = ["COMMANDS", "MODES", "main", "stop_on_error"]


def main(argv: list[str] | None = None) -> None:
    """Runs the command that `argv` (by default the console's words) names; the console script enters here."""
    # At its end Python looks for garbage among all that JAX made, though the process is over anyway.
    atexit.register(gc.freeze)
    words = without_quiet(sys.argv[1:] if argv is None else argv)
    with stop_on_error():
        end_with_parent()
        tell_on_console()
        for word in words:
            word.encode()  # no record, report or checkpoint could hold a name of other letters: told before any work
        if not words or words[0] in ("-h", "--help"):
            print(overview())
        elif words[0] == "--version":
            print(f"jaxsim {version('jaxsim-lidar')}")
        else:
            mode = " ".join(words[:2])
            if mode in MODES:
                call(MODES[mode], words[2:], name=f"jaxsim {mode}")
            else:
                check_mode(words)
                call(find_command(words[0]), words[1:], name=f"jaxsim {words[0]}")
