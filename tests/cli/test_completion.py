"""A real bash completes by the script."""

import shutil
import subprocess

import pytest

from jaxsim.cli import COMMANDS
from jaxsim.cli.completion import Completion, script


@pytest.fixture(scope="module")
def bash(tmp_path_factory):
    program = shutil.which("bash")
    if program is None:
        pytest.skip("no bash")
    path = tmp_path_factory.mktemp("completion") / "jaxsim.sh"
    path.write_text(script("bash"))

    def complete(*words: str) -> list[str]:
        line = " ".join(f"'{word}'" for word in words)
        ask = f"source {path}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _jaxsim"
        ask += '; printf "%s\\n" "${COMPREPLY[@]}"'
        command = [program, "--norc", "-c", ask]
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=path.parent)
        return done.stdout.split()

    return complete


def test_commands_flags_and_names_are_completed(bash):
    assert bash("jaxsim", "dis") == ["discover"]
    assert {*bash("jaxsim", "")} >= {*COMMANDS}
    assert bash("jaxsim", "discover", "--meas") == ["--measured"]
    assert bash("jaxsim", "effects", "beam_g") == ["beam_gain"]
    assert "generation" in bash("jaxsim", "eval", "gen")
    assert "--simulated" in bash("jaxsim", "eval", "generation", "--sim")
    assert "synthetic" in bash("jaxsim", "train", "synth")
    assert bash("jaxsim", "simulate", "embedded", "--qui") == ["--quiet"]


def test_where_nothing_is_known_files_are_offered(bash):
    assert bash("jaxsim", "discover", "jax") == ["jaxsim.sh"]


def test_zsh_gets_the_same_by_its_bash_completion(capsys):
    Completion("zsh")()
    text = capsys.readouterr().out
    assert "bashcompinit" in text
    assert text.endswith(script("bash"))
