"""A row of the table of commands."""

import sys

from jaxsim.cli.command import Command


def test_a_commands_module_is_imported_when_it_is_asked_for(monkeypatch):
    monkeypatch.delitem(sys.modules, "jaxsim.cli.doctor", raising=False)
    command = Command("doctor:Doctor", "versions", "jaxsim doctor")
    assert "jaxsim.cli.doctor" not in sys.modules
    assert command.load() is sys.modules["jaxsim.cli.doctor"].Doctor
