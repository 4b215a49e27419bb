"""A few kills and a full disk; `python -m tests.kills N SEED` does more, of more commands."""

import pytest

from tests.kills.__main__ import main


@pytest.mark.slow
def test_a_killed_simulation_and_one_on_a_full_disk_resume_to_the_same_bytes(capsys):
    assert main(["3", "1", "--only", "simulate"]) == 0, capsys.readouterr().out
    assert "1 commands, 3 attacks" in capsys.readouterr().out
