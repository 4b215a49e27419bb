"""What the loop needs of an experiment, whatever it trains; batches made ahead of it; the card that it leaves."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jax.sharding import Mesh
from jaxtyping import PyTree, UInt8

from jaxsim.config import RunConfig
from jaxsim.data import DATASETS
from jaxsim.files import write_text
from jaxsim.metrics import Score
from jaxsim.prefetch import prefetch
from jaxsim.runs.frames import RunFrames
from jaxsim.runs.kinds import AnyRun, kind_of

Batch = dict[str, Any]
"""Arrays by name, each with the batch's items first."""
RunScores = dict[str, Score]
Picture = UInt8[np.ndarray, "h w 3"]
AHEAD = 4
"""Batches that wait in memory for the devices."""


@dataclass(frozen=True)
class Training:
    """One training, as the builder of its kind makes it. A step is an update: batch k makes step k + 1 of step k."""

    run: AnyRun
    frames: RunFrames
    """What it learns from, and is judged by."""
    steps: int
    save_every: int
    judge_every: int
    state: PyTree
    """The state before the first step; its `step` counts them."""
    mesh: Callable[[int], Mesh | None]
    """The devices that share batch k; None where one takes it whole."""
    batches: Callable[[int, int], Iterable[Batch]]
    """Batches a to b - 1, on the devices. Batch k depends on (seed, k) alone."""
    step: Callable[[PyTree, Batch, int], tuple[PyTree, dict[str, Any]]]
    """(state, batch k, k) -> the next state and its metrics, among them `finite`."""
    network: str
    """Name, in checkpoints, of the part of the state that is used."""
    used: Callable[[PyTree], PyTree]
    """That part of a state."""
    validate: Callable[[PyTree, int], tuple[RunScores, Picture]]
    """(the used part, its step) -> validation scores, and a picture."""
    facts: tuple[str, ...]
    """Lines of the card that say what was trained, and on what."""
    scored: Callable[[RunScores], str]
    """Validation scores as the card shows them."""
    use: str
    """End of the card: how the run is used."""
    hint: str
    """Last words of the program: what to do next."""
    milestones: frozenset[int] = frozenset()
    """Steps that are saved and judged whatever `save_every` and `judge_every` say; the last one always is."""
    finish: Callable[[PyTree], RunScores] | None = None
    """What is left to do with the part that is used when all steps are done; gives the card's scores. None: the last
    step's are the card's."""

    def due(self, step: int, every: int) -> bool:
        """Whether what is done `every` so many steps is due after this one; 0 is never but at the end."""
        return (every > 0 and step % every == 0) or step == self.steps or step in self.milestones


def run_folder(settings: RunConfig) -> Path:
    """The folder of a run. Raises ValueError where its name leads elsewhere than below `out`."""
    if settings.name in (".", "..") or re.search(r"[/\\\x00]", settings.name):
        raise ValueError(
            f"run: --run.name is {settings.name!r}; it must be the name of a folder below --run.out ({settings.out}), "
            "without / and \\; name another place with --run.out"
        )
    return Path(settings.out) / settings.name


def ahead(loader: Any, start: int, stop: int, *, threads: int = 2) -> Iterator[Any]:
    """Batches `start` to `stop` - 1 in order; while the devices work on one, threads make the next AHEAD."""
    with ThreadPoolExecutor(threads) as pool:
        yield from prefetch(pool, loader.__getitem__, range(start, stop), ahead=AHEAD)


def write_card(folder: Path, run: AnyRun, sentence: str, *, facts: Sequence[str], end: Sequence[str]) -> None:
    """Writes card.md: the head that model hubs read (`other` is the licence of data of one's own), the folder's name, a
    sentence, the facts, a line each, and paragraphs that end it."""
    kind = run.experiment.data.kind
    tags = "\n".join(f"- {tag}" for tag in ("lidar", "jax", kind))
    head = f"---\nlibrary_name: jaxsim\nlicense: {DATASETS[kind].licence}\ntags:\n{tags}\n---"
    parts = (head, f"# {folder.name}", sentence, "\n".join(f"- {fact}" for fact in facts), *end)
    write_text(folder / "card.md", "\n\n".join(parts) + "\n")


def write_training_card(
    folder: Path, training: Training, description: str, *, scores: RunScores, seconds: float
) -> None:
    """Writes the card of what was trained. `description` is the experiment's docstring, `seconds` the time since the
    last start."""
    noun = kind_of(training.run).name
    facts = (
        *training.facts,
        f"{training.steps} steps; {seconds / 60:.1f} minutes since the last start",
        f"jaxsim {training.run.version}; all settings are in config.json",
    )
    sentence = description.splitlines()[0] if description else f"{noun[0].upper()}{noun[1:]}."
    write_card(folder, training.run, sentence, facts=facts, end=(training.scored(scores), training.use))
