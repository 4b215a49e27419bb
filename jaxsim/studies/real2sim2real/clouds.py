"""What kinds of clouds hold, short of a detector: tables and pictures of each class, before any detector is trained."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from jaxsim.files import read_entry
from jaxsim.metrics.cloud_checks import DISTANCES_M, REST, CloudCounts, band_name, classes_in, compare_clouds
from jaxsim.report.canvas import Canvas, save_figure
from jaxsim.report.pictures import Rgb
from jaxsim.report.results import markdown_table, number_or_none, write_results
from jaxsim.studies.real2sim2real import REAL
from jaxsim.studies.real2sim2real.charts import class_chart, drop_picture, intensity_chart

Counts = Mapping[str, CloudCounts]
Table = tuple[tuple[str, ...], list[list[str]]]
BANDS = {band_name(band): f"on one, {band[0]:g}-{band[1]:g} m" for band in DISTANCES_M}
OF_CLASS = {
    "objects": "objects",
    **BANDS,
    "range_m": "range, off by (m)",
    "height_m": "height (m)",
    "intensity": "intensity",
}
OF_SCENE = {
    "points": "points a scene",
    "rest_intensity": "intensity elsewhere, off by",
    "empty": "share of directions empty",
    "empty_off": "off by",
}
WORDS = (
    "Clouds of training scenes, in the detector's range: median points on an object at its distance, and how far the "
    "distributions of its points' range, height and intensity are from the real clouds' (Wasserstein-1)."
)


def check_rows(counts: Counts, kind: str) -> dict[str, dict[str, float]]:
    """Measures of all kinds of clouds for one class; `counts` holds `real` and the others."""
    return compare_clouds(counts[REAL], {name: own for name, own in counts.items() if name != REAL}, kind)


def check_tables(counts: Counts, first: str) -> dict[str, Table]:
    """Title -> heads and rows: whole scenes, then each class that is there, `first` first."""
    classes = classes_in(counts, first)
    tables = {"Whole scenes": _table(check_rows(counts, first), OF_SCENE)}
    return tables | {kind: _table(check_rows(counts, kind), OF_CLASS) for kind in classes}


def _table(rows: Mapping[str, Mapping[str, float]], measures: Mapping[str, str]) -> Table:
    """Bands of distance in which no cloud has an object are left out."""
    shown = {
        name: words
        for name, words in measures.items()
        if name not in BANDS or any(not math.isnan(row[name]) for row in rows.values())
    }
    return ("clouds", *shown.values()), [[kind, *(_cell(row[name]) for name in shown)] for kind, row in rows.items()]


def _cell(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.0f}" if value >= 1000 else f"{value:.4g}"


def check_text(counts: Counts, first: str) -> str:
    """Markdown of all tables."""
    tables = (f"{title}:\n\n{markdown_table(*table)}" for title, table in check_tables(counts, first).items())
    return "\n\n".join([WORDS, *tables])


def check_pictures(counts: Counts, first: str) -> dict[str, Canvas | Rgb]:
    """Name -> picture: drop maps, intensity on `first` and elsewhere, and range, height and intensity on each class."""
    on = {f"on_{kind.lower()}": kind for kind in classes_in(counts, first)} | {"elsewhere": REST}
    return {
        "drops": drop_picture(counts),
        "intensity": intensity_chart(counts, first),
        **{name: class_chart(counts, kind) for name, kind in on.items()},
    }


def plain_rows(counts: Counts, kind: str) -> dict[str, dict[str, float | None]]:
    """Measures of one class for JSON, which has no NaN."""
    return {
        name: {measure: number_or_none(value) for measure, value in row.items()}
        for name, row in check_rows(counts, kind).items()
    }


def checked_kinds(out: Path) -> tuple[str, ...]:
    """Kinds of clouds that OUT/clouds.json compares; none where there is no such file."""
    path = out / "clouds.json"
    return tuple(read_entry(path, "clouds", list[str], by="real2sim2real")) if path.is_file() else ()


def write_checks(out: Path, counts: Counts, first: str, *, pictures: Mapping[str, Rgb]) -> dict[str, Canvas | Rgb]:
    """Writes OUT/clouds.md, OUT/clouds.json, and OUT/pictures: those given and those of the checks; gives all."""
    drawn: dict[str, Canvas | Rgb] = {**pictures, **check_pictures(counts, first)}
    for name, picture in drawn.items():
        save_figure(out / "pictures", name, picture, words=name.replace("_", " "))
    classes = {kind: plain_rows(counts, kind) for kind in classes_in(counts, first)}
    content = {"clouds": list(counts), "classes": classes}
    write_results(out, "clouds", content, text=check_text(counts, first), indent=1)
    return drawn
