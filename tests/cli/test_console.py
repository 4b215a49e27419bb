"""What the library logs is told on the console, and `--quiet` leaves it out."""

import io
import logging
import re
import sys
from pathlib import Path

import pytest

from jaxsim.cli import main
from jaxsim.cli.console import tell_on_console, without_quiet
from jaxsim.progress import QUIET

ROOM = Path(__file__).parents[2] / "jaxsim"


@pytest.fixture(autouse=True)
def again(monkeypatch):
    monkeypatch.setenv(QUIET, "")
    yield
    monkeypatch.undo()
    tell_on_console()


def test_what_is_told_goes_to_stdout_and_warnings_to_stderr(capsys):
    tell_on_console()
    tell_on_console()
    logging.getLogger("jaxsim.some.room").info("one of two")
    logging.getLogger("jaxsim.some.room").warning("beware")
    said = capsys.readouterr()
    assert said.out == "one of two\n"
    assert said.err == "warning: beware\n"


@pytest.mark.parametrize(("encoding", "told"), [("ascii", r"o\xfc \u2248 \udce4"), ("utf-8", r"oü ≈ \udce4")])
def test_what_a_terminal_has_no_letters_for_is_told_by_numbers(encoding, told, monkeypatch):
    shown = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(shown, encoding=encoding, write_through=True))
    tell_on_console()
    print("oü ≈ \udce4")  # the last as Python reads a file's name in another encoding
    assert shown.getvalue().decode(encoding) == f"{told}\n"


@pytest.mark.parametrize("flag", ["--quiet", "-q"])
def test_quiet_is_every_commands(flag, capsys, monkeypatch):
    assert without_quiet(["simulate", flag, "run"]) == ["simulate", "run"]
    tell_on_console()
    logging.getLogger("jaxsim").info("one of two")
    logging.getLogger("jaxsim").warning("beware")
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == "warning: beware\n"


def test_a_command_takes_it_anywhere(capsys):
    main(["--version", "--quiet"])
    assert capsys.readouterr().out.startswith("jaxsim ")


def test_the_library_prints_nothing():
    """What prints is a program: the commands, and modules that are run by `python -m`."""
    printing = [
        str(path.relative_to(ROOM))
        for path in sorted(ROOM.rglob("*.py"))
        if "cli" not in path.parts and re.search(r"(?<![\w.])print\(", path.read_text())
    ]
    assert printing == ["effects/page.py", "simulate/embedded/pack.py"] or printing == ["effects/page.py"]
