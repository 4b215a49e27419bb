"""Ctrl-C and SIGTERM: one way to end early, and moments that neither breaks into."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Terminated(KeyboardInterrupt):
    """SIGTERM, as a scheduler or a container sends it: whoever handles Ctrl-C handles it too."""


@contextmanager
def terminable() -> Iterator[None]:
    """Makes SIGTERM raise Terminated in the block, so that a stopped job saves what Ctrl-C would save.

    Only a program's main thread may ask for signals; in another nothing changes.
    """

    def stop(number: int, frame: Any) -> NoReturn:
        raise Terminated

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Holds Ctrl-C and SIGTERM back until the block has ended: for what must not stop half way.

    A second one of a kind is the same as the first. In a thread other than the main one nothing changes: signals never
    arrive there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    before = {number: signal.signal(number, lambda number, frame: held.append(number)) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(held):
            signal.raise_signal(number)


@contextmanager
def unheard_by_children() -> Iterator[None]:
    """Keeps Ctrl-C from processes that are started in the block, for good: a terminal sends it to all of a command's,
    and the one that started the others answers for them. It reaches this one after the block."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
