"""Every row of the table of commands."""

import pytest

from jaxsim.cli import COMMANDS, MODES, main
from jaxsim.cli.running import call

EVERY = {**COMMANDS, **MODES}


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
