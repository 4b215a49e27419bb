"""Signals: SIGTERM is an interrupt, and what must not stop half way does not."""

import os
import signal
import subprocess
import sys
import threading
import time

import psutil
import pytest

from jaxsim.interrupts import (
    PARENT,
    SIGNALS,
    Terminated,
    apart,
    end_with_parent,
    terminable,
    unheard_by_children,
    uninterrupted,
)
from tests.programs import PATIENCE_S


def test_sigterm_is_an_interrupt_in_the_block_and_what_it_was_after_it():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Terminated), terminable():
        os.kill(os.getpid(), signal.SIGTERM)
    assert issubclass(Terminated, KeyboardInterrupt)
    assert signal.getsignal(signal.SIGTERM) is before


class Interrupted:
    """Something in whose end a signal arrives: what is raised there goes nowhere."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        signal.raise_signal(self.number)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_that_python_would_drop_comes_again(number, capsys):
    before = sys.unraisablehook

    def work() -> None:
        with terminable():
            one = Interrupted(number)
            del one
            time.sleep(60)

    with pytest.raises(KeyboardInterrupt) as stopped:
        work()
    assert isinstance(stopped.value, Terminated) == (number == signal.SIGTERM)
    assert sys.unraisablehook is before
    assert not capsys.readouterr().err


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_waits_until_the_block_has_ended(number):
    done = []

    def work() -> None:
        with terminable():
            with uninterrupted():
                os.kill(os.getpid(), number)
                done.append("first half")
                os.kill(os.getpid(), number)
                done.append("second half")
            done.append("what follows")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["first half", "second half"]


def test_blocks_may_lie_in_one_another():
    done = []

    def work() -> None:
        with uninterrupted():
            with uninterrupted():
                os.kill(os.getpid(), signal.SIGINT)
            done.append("the outer block goes on")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done


def test_other_threads_pass_through():
    seen = []

    def work() -> None:
        with terminable(), uninterrupted():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGINT)]


def test_children_do_not_hear_what_a_terminal_sends_to_all():
    says = "import signal, time; print('ready', flush=True); time.sleep(0.3); print('unharmed')"
    with unheard_by_children():
        child = subprocess.Popen([sys.executable, "-c", says], stdout=subprocess.PIPE, text=True)
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        child.send_signal(signal.SIGINT)
        assert child.stdout.read() == "unharmed\n"
    assert child.returncode == 0


def test_work_apart_raises_here_what_it_raised_there():
    done = []
    apart(lambda: done.append(threading.current_thread().name), by="aside")
    assert done == ["aside"]
    with pytest.raises(ZeroDivisionError):
        apart(lambda: 1 // 0, by="aside")


GIVEN_UP = """
import os, signal, threading, time
from jaxsim.interrupts import apart, leave, terminable

def work():
    threading.Thread(target=time.sleep, args=(3600,)).start()  # Python's end would wait for it
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(3600)

try:
    with terminable():
        apart(work, by="aside")
except KeyboardInterrupt:
    print("said")
    leave(143)
"""


def test_work_that_was_given_up_does_not_hold_the_end_up():
    ended = subprocess.run([sys.executable, "-c", GIVEN_UP], capture_output=True, text=True, timeout=PATIENCE_S)
    assert (ended.returncode, ended.stdout, ended.stderr) == (143, "said\n", "")


STARTS_ANOTHER = """
import os, subprocess, sys, time
from jaxsim.interrupts import ends_with_me
subprocess.Popen([sys.executable, "-c", sys.argv[1]], env={**os.environ, **ends_with_me()})
time.sleep(600)
"""
WORKS = """
import os, time
from jaxsim.interrupts import Terminated, end_with_parent, terminable
try:
    with terminable():
        end_with_parent()
        print(os.getpid(), "JAXSIM_PARENT" in os.environ, flush=True)
        time.sleep(600)
except Terminated:
    print("saved", flush=True)
"""


def test_a_process_ends_in_order_with_the_one_that_it_works_for():
    command = [sys.executable, "-c", STARTS_ANOTHER, WORKS]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        number, inherited = parent.stdout.readline().split()
        assert (psutil.pid_exists(int(number)), inherited) == (True, "False")
        parent.kill()
        # Both write to one pipe, which closes when both are gone.
        assert parent.communicate(timeout=PATIENCE_S)[0] == "saved\n"


def test_a_process_that_works_for_none_goes_on(monkeypatch):
    monkeypatch.delenv(PARENT, raising=False)
    before = threading.active_count()
    end_with_parent()
    assert threading.active_count() == before
