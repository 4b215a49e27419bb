"""What Real2Sim2Real scored, the paper's tables with ours beside them, and what they say."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from jaxsim.config.ranges import Whole
from jaxsim.effects.chain import SensorModel
from jaxsim.files import read_entry, write_text
from jaxsim.metrics.detection import DIFFICULTIES, PRINTED_COLUMNS, Curve
from jaxsim.report.results import markdown_table
from jaxsim.studies.real2sim2real import REAL, Loop
from jaxsim.studies.real2sim2real.charts import Counts, Table, check_text, cloud_measures

Percent = Annotated[float, Ge(0), Le(100)]
Paper = dict[str, dict[str, tuple[float, ...]]]
HEADS = ("3D@0.7", "BEV@0.7", "3D@0.5", "BEV@0.5", "2D@0.7", "AOS@0.7")
"""COLUMNS as the papers print them."""
PAPER_ON_REAL: Paper = {
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
PAPER_OF_REAL: Paper = {
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
    write_text(path, json.dumps({"unit": "%", "frames": frames, "checkpoints": curves}, indent=1))


@dataclass(frozen=True)
class Average:
    """AP R40 over the last checkpoints and the seeds, percent."""

    mean: float
    spread: float | None
    """Standard deviation over seeds of the mean over checkpoints; None for one seed."""
    seeds: int
    labels: int


@dataclass(frozen=True)
class Scored:
    """A checkpoint's entry of a file of scores."""

    step: int
    ap_r40: dict[str, Percent | None]
    labels: dict[str, Whole]


def read_checkpoints(loop: Loop, trained: str, judged: str, *, seed: int) -> list[Scored]:
    """What `write_score` kept of one detector, a dict a checkpoint; none where it is not scored."""
    path = loop.score(trained, judged, seed)
    return read_entry(path, "checkpoints", list[Scored], by="real2sim2real") if path.is_file() else []


def read_average(loop: Loop, trained: str, judged: str, *, column: tuple[str, str], difficulty: str) -> Average | None:
    """A cell of the tables, over the seeds that were scored; None where none was, or no label counts."""
    key = f"{column[0]} {column[1]} {difficulty}"
    values = []
    labels = 0
    for seed in loop.config.seeds:
        checkpoints = read_checkpoints(loop, trained, judged, seed=seed)
        averages = [ap for c in checkpoints if (ap := c.ap_r40.get(key)) is not None]
        if averages:
            values.append(float(np.mean(averages)))
            labels = checkpoints[-1].labels.get(difficulty, 0)
    if not values:
        return None
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Average(float(np.mean(values)), spread, len(values), labels)


def epochs_on_real(loop: Loop) -> dict[str, list[list[float]]]:
    """Kind -> for each seed, moderate 3D AP on real clouds at its last checkpoints; none where no label counts."""
    key = " ".join((*PRINTED_COLUMNS[0], "moderate"))
    curves = {}
    for kind in (REAL, *loop.config.kinds):
        seeds = [of_seed for seed in loop.config.seeds if (of_seed := read_checkpoints(loop, kind, REAL, seed=seed))]
        known = seeds and seeds[0][0].ap_r40.get(key) is not None
        curves[kind] = [[c.ap_r40.get(key) or 0.0 for c in one] for one in seeds] if known else []
    return curves


def score_rows(loop: Loop, *, of_real: bool) -> list[tuple[str, str, list[tuple[Average | None, float | None]]]]:
    """(kind, difficulty, cells) of the paper's second table, or `of_real` its third; a cell is ours, the paper's."""
    paper = PAPER_OF_REAL if of_real else PAPER_ON_REAL
    rows = []
    for kind in loop.config.kinds if of_real else loop.trained:
        trained, judged = (REAL, kind) if of_real else (kind, REAL)
        for difficulty in DIFFICULTIES:
            theirs = paper.get(kind, {}).get(difficulty) or [None] * len(PRINTED_COLUMNS)
            ours = [read_average(loop, trained, judged, column=c, difficulty=difficulty) for c in PRINTED_COLUMNS]
            rows.append((kind, difficulty, list(zip(ours, theirs, strict=True))))
    return rows


def answer(loop: Loop) -> str:
    """Whether simulated intensity was worth anything: moderate 3D AP on real clouds, against depth alone, over the
    seeds that both have."""
    compared = ("simulated_64", "raw_64")
    absent = [kind for kind in compared if kind not in loop.config.kinds]
    if absent:
        return (
            f"What simulated intensity is worth is not asked: of {' and '.join(compared)}, no {' and '.join(absent)}."
        )
    both = [
        seed for seed in loop.config.seeds if all(read_checkpoints(loop, kind, REAL, seed=seed) for kind in compared)
    ]
    if not both:
        return "Not all detectors are scored yet."
    of_both = replace(loop, config=replace(loop.config, seeds=tuple(both)))

    def moderate(kind: str) -> Average | None:
        return read_average(of_both, kind, REAL, column=PRINTED_COLUMNS[0], difficulty="moderate")

    simulated, raw = moderate("simulated_64"), moderate("raw_64")
    if simulated is None or raw is None:
        return f"No label of {loop.target} in the real clouds counts as moderate: what was learned is not told."
    gain = simulated.mean - raw.mean
    spread = f"over {len(both)} seeds" if simulated.spread is not None else "one seed, so the spread is not known"
    text = (
        f"Cars in real clouds, moderate, 3D AP: {simulated.mean:.1f} after training on simulated intensity, "
        f"{raw.mean:.1f} without it ({gain:+.1f}"
    )
    if simulated.spread is not None and raw.spread is not None:
        text += f"; standard deviation over seeds {simulated.spread:.1f} and {raw.spread:.1f}"
    real = moderate(REAL)
    return f"{text}; {spread})" + (f"; {real.mean:.1f} after training on real clouds." if real else ".")


def discovered_effects(loop: Loop) -> str:
    """What `discover` found the sensor to lack."""
    if not loop.effects.is_file():
        return "discover was not asked"
    return ", ".join(name for name, _ in SensorModel.load(loop.effects).effects) or "nothing"


def loop_table(loop: Loop, *, of_real: bool) -> Table:
    """Heads, and the rows of `score_rows` as text: ours, the paper's in brackets."""
    heads = ("scored on" if of_real else "trained on", "difficulty", "labels", *HEADS)
    lines = []
    for kind, difficulty, cells in score_rows(loop, of_real=of_real):
        labels = next((str(ours.labels) for ours, _ in cells if ours), "-")
        lines.append([kind, difficulty, labels, *(_cell(ours, theirs) for ours, theirs in cells)])
    return heads, lines


def _cell(ours: Average | None, theirs: float | None) -> str:
    text = "-" if ours is None else f"{ours.mean:.2f}"
    text += f" ± {ours.spread:.2f}" if ours and ours.spread is not None else ""
    return f"{text} ({'-' if theirs is None else f'{theirs:.2f}'})"


def loop_tables(loop: Loop, counts: Counts) -> str:
    """Markdown: both tables of scores, ours (the paper's), and the checks of the clouds."""
    return "\n\n".join(
        [
            answer(loop),
            f"The sensor was found to lack: {discovered_effects(loop)}.",
            f"Trained on a kind of cloud, scored on real ones; AP R40 of {loop.target}, last epochs (the paper's):",
            markdown_table(*loop_table(loop, of_real=False)),
            "Trained on real clouds, scored on each kind:",
            markdown_table(*loop_table(loop, of_real=True)),
            check_text(counts, loop.target),
        ]
    )


def plain_tables(loop: Loop, counts: Counts) -> dict[str, object]:
    """All tables for JSON."""
    return {
        "answer": answer(loop),
        "on_real": _plain_rows(loop, of_real=False),
        "of_real": _plain_rows(loop, of_real=True),
        "clouds": cloud_measures(counts, loop.target),
    }


def _plain_rows(loop: Loop, *, of_real: bool) -> list[dict[str, object]]:
    rows = []
    for kind, difficulty, cells in score_rows(loop, of_real=of_real):
        row: dict[str, object] = {"clouds": kind, "difficulty": difficulty, "unit": "%"}
        for head, (ours, paper) in zip(HEADS, cells, strict=True):
            known = {"value": ours and ours.mean, "spread": ours and ours.spread, "seeds": ours and ours.seeds}
            row[head] = {**known, "paper": paper}
        rows.append(row)
    return rows
