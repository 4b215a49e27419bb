"""A command at work in its own group of processes, and the processor time that the group has taken."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.programs import environment, processor_s

PATIENCE_S = 20.0
"""Processor time that a command which was asked to stop may still take: a step, and the saving of its state."""


class Running:
    """`jaxsim WORDS`, started in the folder `work`; `largest` is the size in bytes of a file that it may write."""

    def __init__(
        self, words: tuple[str, ...], work: Path, cache: Path, *, largest: int | None = None, log: str = "said"
    ):
        self._log = work / log
        self.took_s = 0.0
        with self._log.open("wb") as said:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "jaxsim", *words],
                cwd=work,
                env=environment(JAX_COMPILATION_CACHE_DIR=str(cache / "xla"), JAX_DISABLE_MOST_OPTIMIZATIONS="1"),
                stdout=said,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        if largest is not None:
            resource.prlimit(self._process.pid, resource.RLIMIT_FSIZE, (largest, largest))

    @property
    def said(self) -> str:
        return self._log.read_text(errors="replace")

    @property
    def code(self) -> int | None:
        return self._process.returncode

    def wait(self) -> int:
        """Its exit code, once it has ended."""
        while self._process.poll() is None:
            self.took_s = max(self.took_s, self._spent_s())
            time.sleep(0.05)
        return self._process.returncode

    def reach(self, at_s: float) -> bool:
        """Waits until it has taken so much processor time; whether it got there before its end.

        Of processor time, not by the clock: a machine that is busy now and idle then moves no moment.
        """
        while self._process.poll() is None:
            if self._spent_s() >= at_s:
                return True
            time.sleep(0.02)
        return False

    def end(self, *, hard: bool) -> int:
        """Ends all its processes at once, or asks it to stop as a scheduler does; the exit code."""
        if hard:
            os.killpg(self._process.pid, signal.SIGKILL)
        else:
            asked_s = self._spent_s()
            self._process.send_signal(signal.SIGTERM)
            while self._process.poll() is None and self._spent_s() < asked_s + PATIENCE_S:
                time.sleep(0.05)
            # One that does not stop is killed, and its exit code says so.
            os.killpg(self._process.pid, signal.SIGABRT) if self._process.poll() is None else None
        return self._process.wait()

    def _spent_s(self) -> float:
        """Seconds of the group's processes."""
        found = 0.0
        for place in Path("/proc").glob("[0-9]*"):
            try:
                if os.getpgid(int(place.name)) == self._process.pid:
                    found += processor_s(int(place.name))
            except OSError:  # it has ended meanwhile
                continue
        return found
