"""The console script: its help, its version, and what it imports."""

import subprocess
import sys

import pytest

from jaxsim.cli import COMMANDS, MODES, main
from jaxsim.cli.commands import Command, call

HEAVY = ("jax", "tyro", "cv2", "numpy", "tensorflow_datasets")
EVERY = {**COMMANDS, **MODES}

ENDLESS = """
from jaxsim.cli import stop_on_error
with stop_on_error():
    for _ in range(100_000):
        print("line")
"""


def modules_after(code: str) -> set[str]:
    """Names in sys.modules after a program of its own."""
    program = f"import sys\n{code}\nprint(*sys.modules)"
    return set(
        subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout.split()
    )


@pytest.mark.parametrize(
    "code", ["import jaxsim", "import jaxsim.cli", "from jaxsim.cli import main; main(['--help'])"]
)
def test_neither_the_package_nor_its_help_imports_jax_or_a_command(code: str):
    modules = modules_after(code)
    assert not modules & {*HEAVY}
    assert not modules & {f"jaxsim.cli.{command.home.split(':')[0]}" for command in COMMANDS.values()}


def test_help_prints_a_line_a_command(capsys):
    main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    for name, command in COMMANDS.items():
        assert [line.split(maxsplit=1) for line in lines if line.startswith(f"  {name} ")] == [[name, command.summary]]
    assert len(lines) < len(COMMANDS) + 8
    main([])
    assert capsys.readouterr().out.splitlines() == lines


def test_version_is_the_packages(capsys):
    main(["--version"])
    assert capsys.readouterr().out.split()[0] == "jaxsim"


@pytest.mark.parametrize(("typed", "meant"), [("simulat", "simulate"), ("evaluate", "eval"), ("discvoer", "discover")])
def test_an_unknown_command_answers_with_the_nearest_and_all_known_ones(typed: str, meant: str):
    with pytest.raises(SystemExit, match=f"no command '{typed}'; did you mean {meant}") as stop:
        main([typed])
    assert all(name in str(stop.value) for name in COMMANDS)


@pytest.mark.parametrize("name", EVERY)
def test_the_help_of_every_command_begins_with_an_example(name: str, capsys):
    example = EVERY[name].example
    assert example.startswith(f"jaxsim {name}")
    with pytest.raises(SystemExit) as stop:
        main([*name.split(), "--help"])
    assert not stop.value.code
    usage, *said = [line.strip(" │") for line in capsys.readouterr().out.splitlines() if line.strip(" │")]
    assert usage.startswith("usage: ")
    assert said[0].startswith(example)


@pytest.mark.parametrize("name", EVERY)
def test_every_example_parses(name: str, monkeypatch):
    command, called = EVERY[name], []
    entry = command.load()
    if isinstance(entry, type):
        monkeypatch.setattr(entry, "__call__", lambda flags: called.append(flags))
        call(command, command.example.removeprefix(f"jaxsim {name}").split(), name="jaxsim")
        assert isinstance(called[0], entry)


def test_a_function_gets_the_words_that_follow(monkeypatch):
    taken = []
    monkeypatch.setattr("jaxsim.cli.train.run", taken.append)
    call(Command("train:run", "", ""), ["a", "--b"], name="jaxsim train")
    assert taken == [["a", "--b"]]


def test_a_reader_that_stops_reading_ends_the_program_without_a_traceback():
    with subprocess.Popen([sys.executable, "-c", ENDLESS], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as writer:
        assert writer.stdout
        assert writer.stderr
        assert writer.stdout.readline() == b"line\n"
        writer.stdout.close()
        assert writer.stderr.read() == b""
    assert writer.returncode == 141
