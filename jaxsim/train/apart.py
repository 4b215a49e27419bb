"""Training in a process of its own, which gives its memory back and whose kill costs no other."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from jaxsim.train.experiments import CONFIGS

TRAINER = (sys.executable, "-m", "jaxsim.cli", "train")


def train_apart(*arguments: str | Path, trainer: Sequence[str] = TRAINER) -> int:
    """Runs `jaxsim train ARGUMENTS`, or another `trainer`, of this very package; its exit status."""
    environment = dict(os.environ)
    if (CONFIGS.parent / "jaxsim").is_dir():  # a checkout, which need not be installed
        paths = (str(CONFIGS.parent), os.environ.get("PYTHONPATH", ""))
        environment["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    return subprocess.run([*trainer, *map(str, arguments)], env=environment).returncode
