"""How far a long task is: a bar, lines, or nothing."""

import contextlib
import gc
import io
import os
import termios
import time
import weakref

import pytest

from jaxsim import progress
from jaxsim.progress import Progress, check_all_done, counted
from tests.programs import PATIENCE_S


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def loud(monkeypatch):
    monkeypatch.delenv(progress.QUIET, raising=False)


def test_a_terminal_gets_a_bar_in_one_line():
    terminal = Terminal()
    for _ in Progress(range(3), desc="simulating", unit="frame", file=terminal, mininterval=0):
        pass
    text = terminal.getvalue()
    assert "\r" in text
    assert "3/3" in text
    assert text.count("\n") == 1


def test_a_log_file_gets_a_line_at_times_with_how_far_and_until_when(monkeypatch):
    log = io.StringIO()
    now = [0.0]
    monkeypatch.setattr("tqdm.std.time", lambda: now[0])
    bar = Progress(total=100, desc="simulating", unit="frame", file=log)
    bar._time = lambda: now[0]
    for _ in range(100):
        now[0] += 1.0
        bar.update()
    bar.close()
    lines = log.getvalue().splitlines()
    assert 3 <= len(lines) <= 5
    assert "\r" not in log.getvalue()
    assert lines[0].startswith("simulating: 30 of 100 frames, 00:30 so far, 01:10 left")
    assert lines[-1].startswith("simulating: 100 of 100 frames")


def read_to_end(terminal: int) -> bytes:
    """All that was written to a closed terminal; what one read gives may end anywhere."""
    text = b""
    with contextlib.suppress(OSError):  # Linux says "input/output error" for the end, others nothing more.
        while part := os.read(terminal, 10_000):
            text += part
    return text


@pytest.mark.parametrize(("columns", "is_drawn"), [(100, True), (0, False)])
def test_a_terminal_without_columns_is_a_log(columns, is_drawn):
    """As those that containers and CI give to programs."""
    ours, theirs = os.openpty()
    termios.tcsetwinsize(theirs, (40, columns))
    with open(theirs, "w") as terminal:
        assert progress.is_screen(terminal) is is_drawn
        bar = Progress(total=3, desc="simulating", file=terminal)
        bar.update(3)
        bar.close()
    text = read_to_end(ours).decode()
    os.close(ours)
    assert ("simulating: 3 of 3" in text) is not is_drawn
    assert ("3/3" in text) is is_drawn


def test_a_log_is_told_of_a_step_that_takes_long(monkeypatch):
    """As a first one that compiles."""
    monkeypatch.setattr(progress, "FIRST_LINE_S", 0.05)
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.2)
    log = io.StringIO()
    begun = time.monotonic()
    bar = Progress(total=4, desc="simulating", unit="frame", file=log)
    while log.getvalue().count("\n") < 2:
        assert time.monotonic() < begun + PATIENCE_S
        time.sleep(0.02)
    lines = log.getvalue().splitlines()
    assert len(lines) <= 2 + (time.monotonic() - begun) / 0.2
    assert lines[0] == "simulating: 0 of 4 frames, 00:00 so far, ? left"
    bar.close()
    told = log.getvalue()
    time.sleep(0.4)
    assert log.getvalue() == told


def test_a_task_that_nobody_holds_says_no_more(monkeypatch):
    # Long enough for a busy machine to let go of it before its first line is due.
    monkeypatch.setattr(progress, "FIRST_LINE_S", 0.5)
    log = io.StringIO()
    held = weakref.ref(Progress(total=4, file=log))
    gc.collect()
    time.sleep(0.7)
    assert held() is None
    assert log.getvalue() == ""


def test_a_short_task_that_never_moved_writes_nothing():
    log = io.StringIO()
    Progress(total=5, initial=5, file=log).close()
    assert log.getvalue() == ""


def test_the_last_line_is_written_once():
    """Whoever draws it before the end, as a training does beside its losses."""
    log = io.StringIO()
    bar = Progress(total=5, desc="training", unit="step", file=log)
    bar.update(5)
    bar.refresh()
    bar.close()
    assert log.getvalue().count("training: 5 of 5") == 1


def test_quiet_is_quiet(monkeypatch):
    monkeypatch.setenv(progress.QUIET, "1")
    log = io.StringIO()
    assert list(Progress(range(3), file=log)) == [0, 1, 2]
    assert log.getvalue() == ""


def test_a_unit_that_ends_with_s_has_a_plural():
    log = io.StringIO()
    for unit in ("pass", "frame"):
        for _ in Progress(range(2), desc="matching", unit=unit, file=log, mininterval=0):
            pass
    assert "2 of 2 passes, " in log.getvalue()
    assert "2 of 2 frames, " in log.getvalue()


def test_one_is_no_plural():
    assert [counted(number, "frame") for number in (0, 1, 2)] == ["0 frames", "1 frame", "2 frames"]


def test_what_failed_is_told_once_all_others_are_done():
    check_all_done([], 5, by="x")
    with pytest.raises(ValueError, match=r"^x: 4 of 5 pieces of work failed.* a; b; c \(and 1 more\)$"):
        check_all_done(["a", "b", "c", "d"], 5, by="x")
