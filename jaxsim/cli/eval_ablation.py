"""`jaxsim eval ablation`: its flags, and after `--` those of the training."""

from __future__ import annotations

from jaxsim.cli.ablation import Ablation, ablation
from jaxsim.cli.commands import parse
from jaxsim.cli.eval import MODES


def run(words: list[str]) -> None:
    """Runs the command on the words that follow its name."""
    end = words.index("--") if "--" in words else len(words)
    asked = parse(Ablation, words[:end], name="jaxsim eval ablation", example=MODES["ablation"].example)
    ablation(asked, flags=words[end + 1 :])
