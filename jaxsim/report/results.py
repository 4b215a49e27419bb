"""Results as files: JSON for programs, Markdown tables for people, and a page where there is one."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.files import write_text
from jaxsim.metrics import Score
from jaxsim.metrics.frechet import FrechetScore
from jaxsim.progress import counted

Scores = Mapping[str, Mapping[str, Score]]
"""Predictor -> score's name -> score."""


def write_results(
    folder: Path, name: str, content: Mapping[str, Any], *, text: str, page: str = "", indent: int = 2
) -> Path:
    """Writes NAME.md from `text`, NAME.html if there is a page, and NAME.json from `content`: structs as objects,
    arrays as lists, and null for what is not finite. Gives the path of the page, or else of the Markdown.

    Each file appears whole or not at all, and JSON last: where it is, the others are.
    """
    files = {"md": f"{text}\n", "html": page, "json": json.dumps(_plain(content), indent=indent)}
    for suffix in [suffix for suffix, words in files.items() if words]:
        write_text(folder / f"{name}.{suffix}", files[suffix])
    return folder / f"{name}.{'html' if page else 'md'}"


def list_facts(about: Mapping[str, Any]) -> str:
    """Facts as a Markdown list, a line `- name: value` each."""
    return "\n".join(f"- {name}: {value}" for name, value in about.items())


def markdown_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A line of heads, a rule, a line a row; a `|` or a new line of a cell, as names of folders may hold, ends none."""
    cells = [[" ".join(cell.replace("|", "\\|").splitlines()) for cell in line] for line in (heads, *rows)]
    head, *others = [f"| {' | '.join(line)} |" for line in cells]
    return "\n".join([head, f"|{'---|' * len(heads)}", *others])


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    elif is_dataclass(value):
        value = vars(value)
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(one) for one in (value.tolist() if isinstance(value, np.ndarray) else value)]
    # It has neither NaN, where nothing counts and there is nothing to average, nor infinity, of errors of 0.
    return None if isinstance(value, float) and not math.isfinite(value) else value


def score_heads(scores: Mapping[str, Score]) -> list[str]:
    """Names with their units."""
    return [name if score.unit == "1" else f"{name} ({score.unit})" for name, score in scores.items()]


def score_text(score: Score) -> str:
    """A score as tables show it: two digits of decibels, four of all else."""
    return f"{score.value:.{2 if score.unit == 'dB' else 4}f}"


_Interval = tuple[float, float]
Intervals = Mapping[str, Mapping[str, _Interval]]
"""Predictor -> score's name -> its interval over scenes."""


def score_table(scores: Scores, intervals: Intervals | None = None) -> str:
    """A Markdown table: one row a predictor, one column a score, with its interval where there is one."""
    heads = score_heads(next(iter(scores.values())))
    rows = []
    for who, row in scores.items():
        of = (intervals or {}).get(who, {})
        rows.append([who, *(_with_interval(s, of.get(name)) for name, s in row.items()), f"{row['mae'].count}"])
    return markdown_table(["predictor", *heads, "cells"], rows)


def _with_interval(score: Score, interval: _Interval | None) -> str:
    if interval is None or not all(map(math.isfinite, interval)):
        return score_text(score)
    low, high = interval
    low_text = score_text(score._replace(value=low))
    high_text = score_text(score._replace(value=high))
    return f"{score_text(score)} ({low_text}..{high_text})"


def difference_table(differences: Mapping[str, tuple[float, float, float]]) -> str:
    """A Markdown table: the network's error minus each baseline's, on the same cells."""
    rows = [[who, f"{value:+.4f} ({low:+.4f}..{high:+.4f})"] for who, (value, low, high) in differences.items()]
    return markdown_table(["network minus", "mae (intensity), with its interval over scenes"], rows)


def write_scores(
    folder: Path,
    scores: Scores,
    *,
    frames: list[str],
    intervals: Intervals | None = None,
    differences: Mapping[str, tuple[float, float, float]] | None = None,
    scenes: Mapping[str, Scores] | None = None,
    distribution: Mapping[str, Score] | None = None,
) -> str:
    """Writes scores.json and scores.md; gives their tables for a console, which has no room for that of the scenes."""
    content: dict[str, Any] = {"frames": frames, "scores": scores}
    tables = [score_table(scores, intervals)]
    by_scene: list[str] = []
    distributed: list[str] = []
    if intervals and any(intervals.values()):
        content |= {"intervals": intervals, "mae_differences": differences or {}}
        tables.append(difference_table(differences or {}))
    if scenes:
        content["scenes"] = scenes
        rows = [[scene, *(score_text(row["mae"]) for row in by_method.values())] for scene, by_method in scenes.items()]
        by_scene = [markdown_table(["mae by scene", *next(iter(scenes.values()))], rows)]
    if distribution:
        content["distribution"] = distribution
        distributed = [list_scores(distribution)]
    text = [counted(len(frames), "frame"), *tables, *by_scene, *distributed]
    write_results(folder, "scores", content, text="\n\n".join(text))
    return "\n\n".join([*tables, *distributed])


def list_scores(scores: Mapping[str, Score]) -> str:
    """A Markdown table: one row a score."""
    rows = [[name, f"{s.value:.4g}", s.unit, f"{s.count}"] for name, s in scores.items()]
    return markdown_table(["score", "value", "unit", "frames or rays"], rows)


def write_list(folder: Path, name: str, scores: Mapping[str, Score], *, about: dict[str, Any]) -> None:
    """Writes NAME.json and NAME.md; `about` says what was compared."""
    facts = "\n".join(f"{key}: {value}" for key, value in about.items())
    write_results(folder, name, about | {"scores": scores}, text=f"{facts}\n\n{list_scores(scores)}")


def write_frechet(folder: Path, frechet: FrechetScore, *, extractor: str) -> None:
    """Writes frechet.json and frechet.md: the distance, by which network's features, and that of half the images."""
    about = {"extractor": extractor, "images": frechet.counts, "from_half_the_images": frechet.half}
    write_list(folder, "frechet", {frechet.name: Score(frechet.value, "1", frechet.counts[0])}, about=about)
