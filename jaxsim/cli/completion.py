"""`jaxsim completion`: a script with which a shell completes commands, flags, effects and experiments."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from jaxsim.cli.commands import COMMANDS, MODES

SCRIPT = """\
_jaxsim() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" words=""
  if [ "$COMP_CWORD" -eq 1 ]; then
    words="{commands}"
  else
    case "${{COMP_WORDS[1]}} ${{COMP_WORDS[2]}}" in
{modes}
    *) case "${{COMP_WORDS[1]}}" in
{cases}
    esac ;;
    esac
  fi
  COMPREPLY=($(compgen -W "$words" -- "$word"))
  [ "${{#COMPREPLY[@]}}" -eq 0 ] && COMPREPLY=($(compgen -f -- "$word"))
}}
complete -o filenames -F _jaxsim jaxsim
"""
ZSH = "autoload -U +X compinit && compinit -u\nautoload -U +X bashcompinit && bashcompinit\n"
ALWAYS = ("--help", "--quiet")


@dataclass(frozen=True)
class Completion:
    """Prints a script for the shell; it takes effect in this shell by `source <(jaxsim completion bash)`.

    To keep it, write it to ~/.local/share/bash-completion/completions/jaxsim, or source it in ~/.zshrc.
    """

    shell: Annotated[Literal["bash", "zsh"], tyro.conf.Positional]
    """The shell."""

    def __call__(self) -> None:
        print(script(self.shell), end="")


def script(shell: str) -> str:
    """The text of the script."""
    first = {name: flags_of(command.load()) for name, command in COMMANDS.items()}
    second = {name: flags_of(command.load()) for name, command in MODES.items()}
    for name, words in words_after().items():
        first[name] = [*words, *first[name]]
    for mode in MODES:
        command, word = mode.split()
        first[command] = [word, *first[command]]
    commands = " ".join([*COMMANDS, "--help", "--version"])
    text = SCRIPT.format(commands=commands, modes=_cases(second), cases=_cases(first))
    return (ZSH if shell == "zsh" else "") + text


def _cases(words: Mapping[str, Sequence[str]]) -> str:
    return "\n".join(f'    "{name}") words="{" ".join([*some, *ALWAYS])}" ;;' for name, some in words.items())


def flags_of(entry: object) -> list[str]:
    """The long flags of a dataclass of them, read from its help; none of a function, whose flags depend on its first
    word."""
    if not isinstance(entry, type):
        return []
    text = io.StringIO()
    with redirect_stdout(text), suppress(SystemExit):
        tyro.cli(entry, args=["--help"])
    # A flag's own line begins with it; words elsewhere in the help may name others.
    lines = re.findall(r"^[│ ]*(--.*)$", text.getvalue(), re.MULTILINE)
    flags = [flag for line in lines for flag in re.findall(r"(?:^|, )(--[\w.-]+)", line)]
    return [flag for flag in dict.fromkeys(flags) if flag not in ALWAYS]


def words_after() -> dict[str, list[str]]:
    """Words that may follow a command, besides files."""
    from jaxsim.effects import EFFECTS
    from jaxsim.train.experiments import experiment_names

    return {"train": list(experiment_names()), "effects": list(EFFECTS), "simulate": ["embedded"], "eval": ["embedded"]}
