"""Real2Sim2Real for people: the paper's two tables with ours beside them, why they differ, pictures, one page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from jaxsim.detect.results import Found
from jaxsim.detect.scenes import Scene, Scenes
from jaxsim.effects.chain import SensorModel
from jaxsim.evaluate.detector import load_detector, make_find
from jaxsim.files import replacing
from jaxsim.metrics.cloud_checks import CloudCounts
from jaxsim.metrics.detection import COLUMNS, DIFFICULTIES
from jaxsim.report.boxes import draw_above
from jaxsim.report.canvas import data_uri
from jaxsim.report.markdown import markdown_table
from jaxsim.report.page import paragraph, section, table, whole_page
from jaxsim.report.pictures import beside, save_picture
from jaxsim.studies.clouds import WORDS, check_tables, check_text, plain_rows, write_checks
from jaxsim.studies.loop import KINDS, PAPER_OF_REAL, PAPER_ON_REAL, REAL, Average, Loop, read_average
from jaxsim.studies.loop_charts import epochs_chart

Rgb = UInt8[np.ndarray, "h w 3"]
Counts = Mapping[str, CloudCounts]
Paper = Mapping[str, Mapping[str, Sequence[float]]]
HEADS = ("3D@0.7", "BEV@0.7", "3D@0.5", "BEV@0.5", "2D@0.7", "AOS@0.7")
PANEL = 620
"""Height of a cloud from above, pixels."""


def score_rows(loop: Loop, *, of_real: bool) -> list[tuple[str, str, list[tuple[Average | None, float | None]]]]:
    """(kind, difficulty, cells) of the paper's second table, or `of_real` its third; a cell is ours, the paper's."""
    paper: Paper = PAPER_OF_REAL if of_real else PAPER_ON_REAL
    rows = []
    for kind in loop.config.kinds if of_real else loop.trained:
        trained, judged = (REAL, kind) if of_real else (kind, REAL)
        for difficulty in DIFFICULTIES:
            theirs = paper.get(kind, {}).get(difficulty)
            cells = [
                (read_average(loop, trained, judged, column, difficulty), theirs[k] if theirs else None)
                for k, column in enumerate(COLUMNS)
            ]
            rows.append((kind, difficulty, cells))
    return rows


def answer(loop: Loop) -> str:
    """Whether simulated intensity was worth anything: moderate 3D AP on real clouds, against depth alone."""
    found = [read_average(loop, kind, REAL, COLUMNS[0], "moderate") for kind in ("simulated_64", "raw_64", REAL)]
    simulated, raw, real = found
    if simulated is None or raw is None:
        return "Not all detectors are scored yet."
    gain, seeds = simulated.mean - raw.mean, min(simulated.seeds, raw.seeds)
    spread = f"over {seeds} seeds" if simulated.spread is not None else "one seed, so the spread is not known"
    text = (
        f"Cars in real clouds, moderate, 3D AP: {simulated.mean:.1f} after training on simulated intensity, "
        f"{raw.mean:.1f} without it ({gain:+.1f}"
    )
    if simulated.spread is not None and raw.spread is not None:
        text += f"; standard deviation over seeds {simulated.spread:.1f} and {raw.spread:.1f}"
    return f"{text}; {spread})" + (f"; {real.mean:.1f} after training on real clouds." if real else ".")


def found_effects(loop: Loop) -> str:
    """What `discover` found the sensor to lack."""
    if not loop.effects.is_file():
        return "discover was not asked"
    return ", ".join(name for name, _ in SensorModel.load(loop.effects).effects) or "nothing"


def _cell(ours: Average | None, theirs: float | None) -> str:
    text = "-" if ours is None else f"{ours.mean:.2f}"
    text += f" ± {ours.spread:.2f}" if ours and ours.spread is not None else ""
    return f"{text} ({'-' if theirs is None else f'{theirs:.2f}'})"


def _score_cells(loop: Loop, *, of_real: bool) -> list[list[str]]:
    lines = []
    for kind, difficulty, cells in score_rows(loop, of_real=of_real):
        labels = next((str(ours.labels) for ours, _ in cells if ours), "-")
        lines.append([kind, difficulty, labels, *(_cell(ours, theirs) for ours, theirs in cells)])
    return lines


def loop_tables(loop: Loop, counts: Counts) -> str:
    """Markdown: both tables of scores, ours (the paper's), and the checks of the clouds."""
    on, of = (_score_cells(loop, of_real=flag) for flag in (False, True))
    return "\n\n".join(
        [
            answer(loop),
            f"The sensor was found to lack: {found_effects(loop)}.",
            f"Trained on a kind of cloud, scored on real ones; AP R40 of {loop.target}, last epochs (the paper's):",
            markdown_table(("trained on", "difficulty", "labels", *HEADS), on),
            "Trained on real clouds, scored on each kind:",
            markdown_table(("scored on", "difficulty", "labels", *HEADS), of),
            check_text(counts, loop.target),
        ]
    )


def draw_kinds(loop: Loop, scenes: Mapping[str, Scenes]) -> dict[str, Rgb]:
    """One frame of the renderer as each kind of cloud, labelled; nothing where no frame is in all of them."""
    kinds, span = loop.config.kinds, loop.config.detector.voxels.range_m
    shared = set.intersection(*({scene.name for scene in scenes[kind]} for kind in kinds))
    if not shared:
        return {}
    name = max((scene for scene in scenes[kinds[0]] if scene.name in shared), key=_objects).name
    panels = []
    for kind in kinds:
        scene = next(s for s in scenes[kind] if s.name == name)
        title = f"{kind}: {len(scene.points)} points"
        nothing = Found(np.zeros((0, 7), np.float32), np.zeros(0, np.float32))
        panels.append(_panel(scene, span, nothing, title=title))
    return {"clouds": _grid(panels)}


def draw_found(loop: Loop, scenes: Scenes) -> dict[str, Rgb]:
    """The real frame with most labels, and what each detector of the first seed finds in it."""
    detector, real, panels = loop.config.detector, max(scenes, key=_objects), []
    find, seed = make_find(detector), loop.config.seeds[0]
    for kind in loop.trained:
        found, _ = find(load_detector(loop.detector(kind, seed)).network, real.points)
        panels.append(_panel(real, detector.voxels.range_m, found, title=f"trained on {kind}"))
    return {"found": _grid(panels)}


def draw_loop(loop: Loop, scenes: Mapping[str, Scenes]) -> dict[str, Rgb]:
    """Both pictures, of validation scenes by kind of cloud."""
    return draw_kinds(loop, scenes) | draw_found(loop, scenes[REAL])


def _panel(scene: Scene, span: tuple[float, ...], found: Found, *, title: str) -> Rgb:
    labelled = scene.boxes[scene.target]
    return draw_above(
        scene.points, span, found=found.boxes, score=found.score, labelled=labelled, title=title, height=PANEL
    )


def _grid(panels: Sequence[Rgb], *, across: int = 3) -> Rgb:
    """Panels of one size in rows."""
    rows = [beside(panels[k : k + across]) for k in range(0, len(panels), across)]
    width = max(row.shape[1] for row in rows)
    return np.concatenate([np.pad(row, ((0, 4), (0, width - row.shape[1]), (0, 0))) for row in rows])


def _objects(scene: Scene) -> int:
    return int((scene.target & (scene.difficulty >= 0)).sum())


def write_loop(loop: Loop, counts: Counts, pictures: Mapping[str, Rgb]) -> Path:
    """Writes real2sim2real.json, .md and .html (self-contained), and what `write_checks` writes; gives the page."""
    pictures = write_checks(loop.out, counts, loop.target, pictures)
    if epochs := epochs_chart(loop):
        pictures["epochs"] = epochs.pixels()
        save_picture(loop.out / "pictures" / "epochs.png", pictures["epochs"])
    with replacing(loop.out / "real2sim2real.json") as path:
        path.write_text(json.dumps(_plain(loop, counts), indent=1))
    with replacing(loop.out / "real2sim2real.md") as path:
        path.write_text(loop_tables(loop, counts) + "\n")
    with replacing(loop.out / "real2sim2real.html") as path:
        path.write_text(_page(loop, counts, pictures))
    return loop.out / "real2sim2real.html"


def _plain(loop: Loop, counts: Counts) -> dict[str, object]:
    def scores(of_real: bool) -> list[dict[str, object]]:
        return [
            {
                "clouds": kind,
                "difficulty": difficulty,
                "unit": "%",
                **{
                    head: {"value": a and a.mean, "spread": a and a.spread, "seeds": a and a.seeds, "paper": paper}
                    for head, (a, paper) in zip(HEADS, cells, strict=True)
                },
            }
            for kind, difficulty, cells in score_rows(loop, of_real=of_real)
        ]

    return {
        "answer": answer(loop),
        "on_real": scores(False),
        "of_real": scores(True),
        "clouds": plain_rows(counts, loop.target),
    }


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

    on, of = (_score_cells(loop, of_real=flag) for flag in (False, True))
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
                + table(("trained on", "difficulty", "labels", *HEADS), escaped(on), text=2)
                + figure("epochs", "On real clouds, at each checkpoint; a thin line a seed. A rising line is not done"),
            ),
            section(
                "Trained on real clouds, scored on simulated ones",
                table(("scored on", "difficulty", "labels", *HEADS), escaped(of), text=2),
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
