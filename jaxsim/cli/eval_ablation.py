"""`jaxsim eval ablation`: its flags, and after `--` those of the training."""

from __future__ import annotations

import importlib
import sys

from jaxsim.cli.ablation import Ablation, ablation
from jaxsim.cli.commands import parse
from jaxsim.cli.eval import MODES
from jaxsim.cli.real2sim2real import checkout


def run(words: list[str]) -> None:
    """Runs the command on the words that follow its name."""
    end = words.index("--") if "--" in words else len(words)
    asked = parse(Ablation, words[:end], name="jaxsim eval ablation", example=MODES["ablation"].example)
    home = checkout()
    sys.path.insert(0, str(home))
    configs = importlib.import_module("configs")
    ablation(asked, script=home / "train.py", flags=words[end + 1 :], configs=configs)
