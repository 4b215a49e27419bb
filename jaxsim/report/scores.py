"""Scores for people and for programs: Markdown tables, scores.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jaxsim.metrics import Score
from jaxsim.report.markdown import markdown_table
from jaxsim.report.results import write_results

Scores = dict[str, dict[str, Score]]
"""Predictor -> score's name -> score."""


def score_table(scores: Scores) -> str:
    """A Markdown table: one row a predictor, one column a score."""
    first = next(iter(scores.values()))
    head = [name if score.unit == "1" else f"{name} ({score.unit})" for name, score in first.items()]
    rows = [
        [who, *(f"{s.value:.2f}" if s.unit == "dB" else f"{s.value:.4f}" for s in row.values()), f"{row['mae'].count}"]
        for who, row in scores.items()
    ]
    return markdown_table(["predictor", *head, "cells"], rows)


def write_scores(folder: Path, scores: Scores, *, frames: list[str]) -> None:
    """Writes scores.json and scores.md."""
    plain = {who: {name: score._asdict() for name, score in row.items()} for who, row in scores.items()}
    text = f"{len(frames)} frames\n\n{score_table(scores)}"
    write_results(folder, "scores", {"frames": frames, "scores": plain}, text=text)


def list_scores(scores: dict[str, Score]) -> str:
    """A Markdown table: one row a score."""
    rows = [[name, f"{s.value:.4g}", s.unit, f"{s.count}"] for name, s in scores.items()]
    return markdown_table(["score", "value", "unit", "frames or rays"], rows)


def write_list(folder: Path, name: str, scores: dict[str, Score], *, about: dict[str, Any]) -> None:
    """Writes NAME.json and NAME.md; `about` says what was compared."""
    content = about | {"scores": {key: score._asdict() for key, score in scores.items()}}
    facts = "\n".join(f"{key}: {value}" for key, value in about.items())
    write_results(folder, name, content, text=f"{facts}\n\n{list_scores(scores)}")
