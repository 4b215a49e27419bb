"""A run's card: what it is, what it scored, how it is used."""

from __future__ import annotations

from pathlib import Path

from jaxsim.files import replacing
from jaxsim.runs.kinds import kind_of
from jaxsim.train.training import Scores, Training


def write_card(folder: Path, training: Training, description: str, *, scores: Scores, seconds: float) -> None:
    """Writes card.md. `description` is the experiment's docstring, `seconds` the time since the last start."""
    noun = kind_of(training.run).name
    facts = (
        *training.facts,
        f"{training.steps} steps; {seconds / 60:.1f} minutes since the last start",
        f"jaxsim {training.run.version}; all settings are in config.json",
    )
    parts = (
        f"# {folder.name}",
        description.splitlines()[0] if description else f"{noun[0].upper()}{noun[1:]}.",
        "\n".join(f"- {fact}" for fact in facts),
        training.scored(scores),
        training.use,
    )
    with replacing(folder / "card.md") as path:
        path.write_text("\n\n".join(parts) + "\n")
