"""The report of a discovery: one page that opens from disk, and its charts as files."""

from __future__ import annotations

import re
from html import escape
from pathlib import Path

from jaxsim.discover.verdict import Result, Verdict
from jaxsim.files import replacing
from jaxsim.report.answer import named_effects, ranking, unexplained
from jaxsim.report.canvas import Canvas
from jaxsim.report.chance import chance
from jaxsim.report.evidence import curves, gap, maps, moved, where
from jaxsim.report.page import paragraph, section, whole_page
from jaxsim.report.pictures import save_picture
from jaxsim.report.words import verdict_sentence

FIGURES = r"chance|(map|curve|parameter|unexplained)_.*"
"""Names of a report's figures."""


def write_report(folder: Path, result: Result) -> Path:
    """Writes report.html, self-contained, and its charts as figures/NAME.png; gives the path of the page.

    Figures that an earlier report of the folder drew and this one does not are removed.
    """
    folder, charts = Path(folder), dict[str, Canvas]()

    def draw(name: str, canvas: Canvas | None, caption: str) -> str:
        if canvas is None:
            return paragraph(f"{caption} Nothing to draw: no ray could be compared.")
        charts[name] = canvas
        return f"<figure>{canvas.svg(caption)}<figcaption>{escape(caption)}</figcaption></figure>"

    verdict = result.verdict
    outside = verdict.verdict == "not_in_catalogue"
    page = whole_page(
        title=f"jaxsim discover: {verdict.verdict.replace('_', ' ')}",
        sentence=verdict_sentence(verdict),
        facts=_facts(result),
        sections=[
            unexplained(verdict.unexplained, draw, missing=True) if outside else "",
            named_effects(verdict.effects, draw),
            where(verdict.where),
            maps(result, draw),
            curves(result.curves, draw),
            gap(verdict),
            ranking(verdict.ranking, verdict.effects),
            chance(verdict, draw),
            "" if outside else unexplained(verdict.unexplained, draw),
            moved(verdict),
            _scenes(verdict),
        ],
    )
    for old in (folder / "figures").glob("*.png"):
        if re.fullmatch(FIGURES, old.stem) and old.stem not in charts:
            old.unlink()
    for name, canvas in charts.items():
        save_picture(folder / "figures" / f"{name}.png", canvas.pixels())
    with replacing(folder / "report.html") as path:
        path.write_text(page, encoding="utf-8")
    return folder / "report.html"


def _facts(result: Result) -> list[tuple[str, str]]:
    v, grid = result.verdict, result.grid
    return [
        ("frames", str(v.frames)),
        ("grid", f"{len(grid.elevation_rad)} rows × {len(grid.azimuth_rad)} columns"),
        ("scenes to find with", str(len(v.find))),
        ("scenes to judge on", str(len(v.judge))),
        ("time", f"{v.seconds:.0f} s"),
    ]


def _scenes(verdict: Verdict) -> str:
    parts = [paragraph(f"Note: {note}.") for note in verdict.notes]
    for word, names in (
        ("To find and fit", verdict.find),
        ("To judge", verdict.judge),
    ):
        parts.append(f'<p class="names"><b>{word} ({len(names)}):</b> {escape(", ".join(names))}</p>')
    taken = "SHA-256 of this division, taken before anything was fitted"
    parts.append(f'<p class="names">{taken}: <code>{escape(verdict.sha256)}</code></p>')
    return section("Scenes", "".join(parts))
