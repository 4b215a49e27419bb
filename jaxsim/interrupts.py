"""Ctrl-C and SIGTERM: one way to end early, and moments that neither breaks into."""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM)
_AGAIN_S = 0.05
PARENT = "JAXSIM_PARENT"
"""The process that a program works for, and with which it is to end."""
_LOOK_EVERY_S = 1.0


class Terminated(KeyboardInterrupt):
    """SIGTERM, as a scheduler or a container sends it: whoever handles Ctrl-C handles it too."""


@contextmanager
def terminable() -> Iterator[None]:
    """Makes SIGTERM raise Terminated in the block, so that a stopped job saves what Ctrl-C would save. Neither is lost:
    where it arrives in what no exception can leave, it comes again.

    Only a program's main thread may ask for signals; in another nothing changes.
    """

    def stop(number: int, frame: Any) -> NoReturn:
        raise Terminated

    def again(lost: Any) -> None:
        # Python drops what is raised in a `__del__` or a weak reference's callback, of which every import has one.
        if not isinstance(lost.exc_value, KeyboardInterrupt):
            ignored(lost)
            return
        number = signal.SIGTERM if isinstance(lost.exc_value, Terminated) else signal.SIGINT
        later = threading.Timer(_AGAIN_S, resend, (number,))
        later.daemon = True
        later.start()

    def resend(number: int) -> None:
        if signal.getsignal(signal.SIGTERM) is not stop:  # the block has ended
            return
        if hasattr(signal, "pthread_kill"):  # which also wakes a thread that waits
            signal.pthread_kill(threading.main_thread().ident or 0, number)
        else:  # Windows
            _thread.interrupt_main(signal.Signals(number))

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before, ignored = signal.signal(signal.SIGTERM, stop), sys.unraisablehook
    sys.unraisablehook = again
    try:
        yield
    finally:
        if sys.unraisablehook is again:  # else another took its place, which is to stay
            sys.unraisablehook = ignored
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
    signals: list[int] = []
    before = {number: signal.signal(number, lambda number, frame: signals.append(number)) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(signals):
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


def ends_with_me() -> dict[str, str]:
    """What the environment of a process says that is to end with this one, by `end_with_parent`."""
    return {PARENT: str(os.getpid())}


def end_with_parent() -> None:
    """Sends this process SIGTERM once the process is gone that started it with `ends_with_me`: killed by no signal that
    could be handled (SIGKILL, as of a machine out of memory), it would leave its work to one that nobody waits for."""
    # Not for processes that this one starts.
    parent = os.environ.pop(PARENT, "")
    if not parent.isdecimal():
        return

    def watch() -> None:
        # An orphan is given to another parent.
        while os.getppid() == int(parent):
            time.sleep(_LOOK_EVERY_S)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True, name="parent").start()


_given_up = threading.Event()


def apart(work: Callable[[], None], *, by: str) -> None:
    """Does work of a package whose threads cannot be interrupted in a thread `by` that can be given up. What it raises
    is raised here. After Ctrl-C or SIGTERM it goes on by itself until `leave` ends the program.
    """
    failed: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run, name=by, daemon=True)
    try:
        thread.start()
        thread.join()
    except KeyboardInterrupt:
        _given_up.set()
        raise
    if failed:
        raise failed[0]


def leave(code: int) -> NoReturn:
    """Ends the program: at once where work was given up, for Python's own end waits for the threads that the work had
    started, or breaks into those that run C++, which then aborts."""
    if _given_up.is_set():
        sys.stdout.flush()
        os._exit(code)
    sys.exit(code)
