"""How far a long task is: a bar on a terminal, a line at times in a log file, nothing when asked to be quiet."""

from __future__ import annotations

import io
import math
import os
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from tqdm import tqdm

Log = Callable[[str], None]
"""Where lines on the progress of a long task go."""
QUIET = "JAXSIM_QUIET"
"""Set to anything by `--quiet`; processes that a command starts inherit it."""
LINE_EVERY_S = 30.0
"""Seconds between two lines where there is no terminal."""
FIRST_LINE_S = 2.0
"""Seconds after which a task that has written nothing yet says there what it is."""
FAILURES_TOLD = 3
"""Failures that are told of one by one."""
LINE = "{desc}: {n_fmt} of {total_fmt} {units}, {elapsed} so far, {remaining} left{postfix}"


def is_screen(file: Any) -> bool:
    """Whether a bar can be drawn on a file: a terminal, and one that has columns (containers and CI give some none)."""
    if not (hasattr(file, "isatty") and file.isatty()):
        return False
    try:
        return os.get_terminal_size(file.fileno()).columns > 0
    except (OSError, ValueError):
        return True


def counted(number: int, noun: str) -> str:
    """A number of things in words: `1 frame`, `2 frames`, `0 frames`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def check_all_done(failures: Sequence[str], count: int, *, by: str) -> None:
    """Raises ValueError where some of so many pieces of work failed, with what is wrong with the first of them, once
    all others are done."""
    if failures:
        others = f" (and {len(failures) - FAILURES_TOLD} more)" if len(failures) > FAILURES_TOLD else ""
        raise ValueError(
            f"{by}: {len(failures)} of {count} pieces of work failed, the others are done; the same command goes on "
            f"with what is missing. {'; '.join(failures[:FAILURES_TOLD])}{others}"
        )


class Progress(tqdm):
    """tqdm that knows where it is shown: takes what tqdm takes."""

    def __init__(self, iterable: Iterable[Any] | None = None, *, disable: bool = False, **shown: Any):
        file = shown.setdefault("file", sys.stderr)
        self.as_lines = not is_screen(file)
        if self.as_lines:
            shown |= {"mininterval": LINE_EVERY_S, "maxinterval": 2 * LINE_EVERY_S, "delay": 1e-3}
            if shown.get("total") is not None or hasattr(iterable, "__len__"):
                unit = shown.get("unit", "it")
                shown["bar_format"] = LINE.replace("{units}", f"{unit}{'es' if unit.endswith('s') else 's'}")
        self.printed_at = 0
        self.ended = threading.Event()
        self.line_at_s = -math.inf
        super().__init__(iterable, disable=disable or bool(os.environ.get(QUIET)), **shown)
        if self.as_lines and not self.disable:
            # By a weak reference: a task that an error ended is collected, and its lines end.
            threading.Thread(target=_keep_telling, args=(weakref.ref(self), self.ended), daemon=True).start()

    def display(self, msg: str | None = None, pos: int | None = None) -> bool:
        """Writes a line in place of the bar where there is no screen."""
        if not self.as_lines:
            return bool(super().display(msg, pos))
        # tqdm clears a bar by an empty one; a line that is written stays.
        if msg is None and self.n > self.initial:
            self._write_line()
        return True

    def _write_line(self) -> None:
        self.fp.write(f"{self}\n")
        self.fp.flush()
        self.printed_at = self.n
        self.line_at_s = time.monotonic()

    def tell_if_silent(self) -> float:
        """Writes a line if none was written for as long as lines are apart; gives the seconds until it is to be asked
        again."""
        silent_s = time.monotonic() - self.line_at_s
        if silent_s >= LINE_EVERY_S:
            self._write_line()
            return LINE_EVERY_S
        return LINE_EVERY_S - silent_s

    def close(self) -> None:
        """Writes a last line where there is no terminal and something was done since the one before."""
        self.ended.set()
        if self.as_lines and not self.disable:
            if self.leave and self.n > self.printed_at:
                self.display()
            # tqdm ends its bar's line now, and here is none.
            self.fp = io.StringIO()
        super().close()

    def clear(self, nolock: bool = False) -> None:
        if not self.as_lines:
            super().clear(nolock)

    def moveto(self, n: int) -> None:
        if not self.as_lines:
            super().moveto(n)


def _keep_telling(bar: weakref.ref[Progress], ended: threading.Event) -> None:
    """Lines while a single step takes long, as one that compiles: tqdm looks at the clock at steps alone."""
    wait_s = FIRST_LINE_S
    while not ended.wait(wait_s):
        shown = bar()
        if shown is None:
            return
        with shown.get_lock():
            if not ended.is_set():
                wait_s = shown.tell_if_silent()
        del shown
