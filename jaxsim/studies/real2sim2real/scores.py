"""What Real2Sim2Real scored so far, and what the paper scored."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.files import replacing
from jaxsim.metrics.detection import Curve
from jaxsim.studies.real2sim2real.settings import REAL, Loop

PAPER_ON_REAL: dict[str, dict[str, tuple[float, ...]]] = {
    "raw_64": {
        "easy": (63.78, 75.32, 79.93, 80.24, 79.24, 78.58),
        "moderate": (50.50, 62.43, 68.54, 68.91, 66.59, 65.05),
        "hard": (48.70, 62.07, 69.01, 70.02, 66.84, 65.05),
    },
    "raw_32": {
        "easy": (61.40, 73.61, 78.28, 78.62, 77.30, 76.62),
        "moderate": (47.56, 59.57, 65.16, 65.51, 63.73, 61.81),
        "hard": (45.20, 58.15, 64.04, 65.42, 62.90, 60.93),
    },
    "simulated_64": {
        "easy": (63.22, 80.33, 85.69, 86.15, 83.83, 82.10),
        "moderate": (51.74, 70.77, 75.51, 79.71, 72.78, 70.54),
        "hard": (50.27, 69.74, 74.76, 79.07, 71.95, 69.42),
    },
    REAL: {
        "easy": (91.94, 95.36, 98.51, 98.55, 98.46, 98.43),
        "moderate": (82.90, 91.19, 94.78, 95.46, 94.65, 94.52),
        "hard": (80.45, 88.94, 94.49, 94.59, 92.34, 92.14),
    },
}
"""The paper's second table: trained on a kind, scored on KITTI; AP of Car in the order of COLUMNS."""
PAPER_OF_REAL: dict[str, dict[str, tuple[float, ...]]] = {
    "raw_64": {
        "moderate": (88.78, 95.79, 98.94, 99.25, 98.59, 97.89),
        "hard": (77.18, 87.84, 92.47, 93.94, 90.59, 89.51),
    },
    "raw_32": {
        "moderate": (72.93, 90.74, 94.30, 97.54, 89.78, 88.48),
        "hard": (61.20, 80.42, 85.12, 89.96, 79.68, 77.85),
    },
    "simulated_64": {
        "moderate": (86.33, 99.11, 99.89, 99.92, 99.78, 98.35),
        "hard": (81.19, 95.02, 96.89, 96.97, 95.97, 94.37),
    },
}
"""Its third table: trained on KITTI, scored on a kind; nothing is easy there."""


def write_score(path: Path, per_epoch: Sequence[Sequence[Curve]], *, steps: Sequence[int], frames: int) -> None:
    """Keeps AP R40 of every checkpoint."""
    curves = [
        {
            "step": step,
            "ap_r40": {f"{c.metric} {c.overlap_set} {c.difficulty}": c.ap_r40 if c.truths else None for c in curves},
            "labels": {c.difficulty: c.truths for c in curves if (c.metric, c.overlap_set) == ("3d", "0.7")},
        }
        for step, curves in zip(steps, per_epoch, strict=True)
    ]
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({"unit": "%", "frames": frames, "checkpoints": curves}, indent=1))


@dataclass(frozen=True)
class Average:
    """AP R40 over the last checkpoints and the seeds, percent."""

    mean: float
    spread: float | None
    """Standard deviation over seeds of the mean over checkpoints; None for one seed."""
    seeds: int
    labels: int


def read_checkpoints(loop: Loop, trained: str, judged: str, *, seed: int) -> list[dict[str, Any]]:
    """What `write_score` kept of one detector, a dict a checkpoint; none where it is not scored."""
    path = loop.score(trained, judged, seed)
    return json.loads(path.read_text())["checkpoints"] if path.is_file() else []


def read_average(loop: Loop, trained: str, judged: str, *, column: tuple[str, str], difficulty: str) -> Average | None:
    """A cell of the tables, over the seeds that were scored; None where none was, or no label counts."""
    key = f"{column[0]} {column[1]} {difficulty}"
    values = []
    labels = 0
    for seed in loop.config.seeds:
        checkpoints = read_checkpoints(loop, trained, judged, seed=seed)
        found = [c["ap_r40"][key] for c in checkpoints if c["ap_r40"].get(key) is not None]
        if found:
            values.append(float(np.mean(found)))
            labels = checkpoints[-1]["labels"][difficulty]
    if not values:
        return None
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Average(float(np.mean(values)), spread, len(values), labels)
