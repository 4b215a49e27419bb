"""How a word becomes a running command."""

import pytest

from jaxsim.cli import COMMANDS, main
from jaxsim.cli.command import Command
from jaxsim.cli.running import call, check_mode


@pytest.mark.parametrize(("typed", "meant"), [("simulat", "simulate"), ("evaluate", "eval"), ("discvoer", "discover")])
def test_an_unknown_command_answers_with_the_nearest_and_all_known_ones(typed: str, meant: str):
    with pytest.raises(SystemExit, match=f"no command '{typed}'; did you mean {meant}") as stop:
        main([typed])
    assert all(name in str(stop.value) for name in COMMANDS)


def test_a_mistyped_second_word_is_no_runs_name(tmp_path, monkeypatch):
    with pytest.raises(SystemExit, match=r"there is no generatoin; did you mean jaxsim eval generation\?"):
        main(["eval", "generatoin", "--simulated", "a", "--measured", "b"])
    (tmp_path / "detections").mkdir()
    monkeypatch.chdir(tmp_path)
    check_mode(["eval", "detections"])  # a folder that is there is a run
    check_mode(["effects", "beam_gain"])
    check_mode(["eval"])


def test_nothing_is_written_to_a_folder_without_a_name():
    with pytest.raises(SystemExit, match="--out is empty, as of a shell's variable that is not set"):
        main(["frames", "log", "--out", ""])


def test_a_function_gets_the_words_that_follow(monkeypatch):
    taken = []
    monkeypatch.setattr("jaxsim.cli.train.run", taken.append)
    call(Command("train:run", "", ""), ["a", "--b"], name="jaxsim train")
    assert taken == [["a", "--b"]]
