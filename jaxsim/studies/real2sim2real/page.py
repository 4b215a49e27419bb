"""Real2Sim2Real for people: tables, why they differ, pictures, one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from jaxsim.metrics.cloud_checks import CloudCounts
from jaxsim.report.canvas import data_uri
from jaxsim.report.page import paragraph, section, table, whole_page
from jaxsim.report.pictures import save_picture
from jaxsim.report.results import write_results
from jaxsim.studies.real2sim2real.clouds import WORDS, check_tables, write_checks
from jaxsim.studies.real2sim2real.epochs_chart import epochs_chart
from jaxsim.studies.real2sim2real.settings import KINDS, Loop
from jaxsim.studies.real2sim2real.tables import HEADS, answer, found_effects, loop_tables, plain_scores, score_cells

Rgb = UInt8[np.ndarray, "h w 3"]
Counts = Mapping[str, CloudCounts]


def write_loop(loop: Loop, counts: Counts, pictures: Mapping[str, Rgb]) -> Path:
    """Writes real2sim2real.json, .md and .html (self-contained), and what `write_checks` writes; gives the page."""
    pictures = write_checks(loop.out, counts, loop.target, pictures=pictures)
    if epochs := epochs_chart(loop):
        pictures["epochs"] = epochs.pixels()
        save_picture(loop.out / "pictures" / "epochs.png", pictures["epochs"])
    content, text = plain_scores(loop, counts), loop_tables(loop, counts)
    page = _page(loop, counts, pictures)
    return write_results(loop.out, "real2sim2real", content, text=text, page=page, indent=1)


def _page(loop: Loop, counts: Counts, pictures: Mapping[str, Rgb]) -> str:
    def escaped(rows: Sequence[Sequence[str]]) -> list[list[str]]:
        return [[escape(cell) for cell in row] for row in rows]

    def figure(name: str, words: str) -> str:
        if name not in pictures:
            return ""
        image = f'<img src="{data_uri(pictures[name])}" style="width:100%" alt="{escape(words)}">'
        return f"<figure>{image}<figcaption>{escape(words)}</figcaption></figure>"

    checks = check_tables(counts, loop.target)

    def check(title: str) -> str:
        heads, rows = checks[title]
        shown = figure(f"on_{title.lower()}", f"Points on a {title.lower()}: range, height and intensity")
        return f"<h3>{escape(title)}</h3>" + table(heads, escaped(rows), text=1) + shown

    on_real, of_real = score_cells(loop, of_real=False), score_cells(loop, of_real=True)
    known = "".join(paragraph(f"{kind}: {KINDS[kind][1]}.") for kind in loop.config.kinds)
    config = loop.config
    return whole_page(
        title="jaxsim: Real2Sim2Real",
        sentence=answer(loop),
        facts=[
            ("real frames", f"{config.detector.data.kind}, {config.detector.data.validation} to judge"),
            ("renderer", config.synthetic.kind),
            ("the sensor was found to lack", found_effects(loop)),
            ("seeds", ", ".join(map(str, config.seeds))),
            ("detector", f"Voxel R-CNN, {config.detector.optim.epochs} epochs"),
        ],
        sections=[
            section(
                "Trained on simulated clouds, scored on real ones",
                paragraph(
                    f"AP R40 of {loop.target}, percent, mean of the last epochs; in brackets the paper's, on KITTI."
                )
                + table(("trained on", "difficulty", "labels", *HEADS), escaped(on_real), text=2)
                + figure("epochs", "On real clouds, at each checkpoint; a thin line a seed. A rising line is not done"),
            ),
            section(
                "Trained on real clouds, scored on simulated ones",
                table(("scored on", "difficulty", "labels", *HEADS), escaped(of_real), text=2),
            ),
            section(
                "The kinds of clouds", known + figure("clouds", "One frame of the renderer, labelled cars in green")
            ),
            section(
                "Why",
                paragraph(WORDS)
                + "".join(check(title) for title in checks)
                + figure("intensity", "Intensity of the points, logarithmic")
                + figure("elsewhere", "Points on no object: range, height and intensity")
                + figure("drops", "Directions without a return: elevation 4 to -16 degrees, azimuth 42 to -42"),
            ),
            section("One real frame", figure("found", "What each detector finds (orange); labelled cars in green")),
        ],
    )
