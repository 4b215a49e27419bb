"""What all command lines tell, and to whom: the library logs by `logging` and prints nothing itself."""

from __future__ import annotations

import io
import logging
import os
import sys
from collections.abc import Sequence

from jaxsim.progress import QUIET, Progress

FLAGS = ("--quiet", "-q")


class Console(logging.Handler):
    """Writes what is told to stdout, warnings to stderr, between the bars."""

    def emit(self, record: logging.LogRecord) -> None:
        warns = record.levelno >= logging.WARNING
        words = f"warning: {record.getMessage()}" if warns else record.getMessage()
        # The streams of now: a test, or a user's redirection, may have set others.
        stream = sys.stderr if warns else sys.stdout
        Progress.write(words, file=stream)
        stream.flush()


def tell_on_console() -> None:
    """Shows what jaxsim logs; warnings alone where JAXSIM_QUIET is set.

    What a terminal or a file has no letters for is told by numbers (`\\u2248`), as stderr does: no command is to fail
    at its end for the name of a folder.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    logger = logging.getLogger("jaxsim")
    if not any(isinstance(one, Console) for one in logger.handlers):
        logger.addHandler(Console())
        logger.propagate = False
    logger.setLevel(logging.WARNING if os.environ.get(QUIET) else logging.INFO)


def without_quiet(words: Sequence[str]) -> list[str]:
    """The words without `--quiet`, which is every command's and is put into force here, for this process and those that
    it starts."""
    words_left = [word for word in words if word not in FLAGS]
    if len(words_left) < len(words):
        os.environ[QUIET] = "1"
    return words_left
