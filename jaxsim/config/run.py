"""Where a run is kept, and how often it reports."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RunConfig:
    """Where the run is kept and how often it reports."""

    name: str = ""
    """Folder under `out`; empty: the experiment's name."""
    out: Path = Path("runs")
    seed: int = 2
    log_every: int = 10
    save_every: int = 200
    """Steps between checkpoints; a killed run resumes from the last. 0, for a detector: an epoch."""
    picture_every: int = 200
    """Steps between validation scores and pictures (input | predicted | measured). 0, for a detector: an epoch."""
    keep: int = 2
    """Checkpoints kept."""
    distributed: bool = False
    """Train together with the other processes that a launcher started, on all their devices (docs/many-devices.md).
    One process uses all devices of its machine without it."""
