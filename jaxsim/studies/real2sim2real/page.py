"""Real2Sim2Real for people: tables, why they differ, pictures from above, one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from jaxsim.detect.results import Detected
from jaxsim.detect.scenes import Scene
from jaxsim.report.canvas import Canvas, save_figure
from jaxsim.report.clouds import draw_above
from jaxsim.report.page import EMPTY, figure, section, table, whole_page
from jaxsim.report.pictures import Rgb, beside
from jaxsim.report.results import write_results
from jaxsim.report.scenes import TurnedScene, cloud_with_boxes, turning
from jaxsim.studies.real2sim2real import CLOUD_KINDS, Loop, scores
from jaxsim.studies.real2sim2real.charts import WORDS, Counts, check_tables, epochs_chart, write_checks

PANEL = 620
"""Height of a cloud from above, pixels."""


def write_loop(loop: Loop, counts: Counts, pictures: Mapping[str, Rgb], *, clouds: Sequence[TurnedScene] = ()) -> Path:
    """Writes real2sim2real.json, .md and .html (self-contained), and what `write_checks` writes; gives the page.

    `clouds` turn in it.
    """
    drawn = write_checks(loop.out, counts, loop.target, pictures=pictures)
    if epochs := epochs_chart(scores.epochs_on_real(loop)):
        drawn["epochs"] = epochs
        save_figure(loop.out / "pictures", "epochs", epochs, words="AP on real clouds at each checkpoint")
    content, text = scores.plain_tables(loop, counts), scores.loop_tables(loop, counts)
    page = _page(loop, counts, drawn, clouds=clouds)
    return write_results(loop.out, "real2sim2real", content, text=text, page=page, indent=1)


def _page(loop: Loop, counts: Counts, pictures: Mapping[str, Canvas | Rgb], *, clouds: Sequence[TurnedScene]) -> str:
    def drawn(name: str, words: str) -> Markup:
        return figure(pictures[name], words) if name in pictures else EMPTY

    checks, config = check_tables(counts, loop.target), loop.config

    def check(title: str) -> Markup:
        heads, rows = checks[title]
        shown = drawn(f"on_{title.lower()}", f"Points on a {title.lower()}: range, height and intensity")
        return Markup("<h3>{}</h3>").format(title) + table(heads, rows, text=1) + shown

    turned, scenes = turning(clouds, "Labelled cars are green, found ones orange; the crossed side is the front.")
    return whole_page(
        title="jaxsim: Real2Sim2Real",
        sentence=scores.answer(loop),
        facts=[
            ("real frames", f"{config.detector.data.kind}, {config.detector.data.validation} to judge"),
            ("renderer", config.synthetic.kind),
            ("the sensor was found to lack", scores.discovered_effects(loop)),
            ("seeds", ", ".join(map(str, config.seeds))),
            ("detector", f"Voxel R-CNN, {config.detector.optim.epochs} epochs"),
        ],
        sections=[
            section(
                "Trained on simulated clouds, scored on real ones",
                f"AP R40 of {loop.target}, percent, mean of the last epochs; in brackets the paper's, on KITTI.",
                table(*scores.loop_table(loop, of_real=False), text=2),
                drawn("epochs", "On real clouds, at each checkpoint; a thin line a seed. A rising line is not done"),
            ),
            section(
                "Trained on real clouds, scored on simulated ones",
                table(*scores.loop_table(loop, of_real=True), text=2),
            ),
            section(
                "The kinds of clouds",
                *(f"{kind}: {CLOUD_KINDS[kind][1]}." for kind in config.kinds),
                drawn("clouds", "One frame of the renderer, labelled cars in green"),
            ),
            section(
                "Why",
                WORDS,
                *map(check, checks),
                drawn("intensity", "Intensity of the points, logarithmic"),
                drawn("elsewhere", "Points on no object: range, height and intensity"),
                drawn("drops", "Directions without a return: elevation 4 to -16 degrees, azimuth 42 to -42"),
            ),
            section("One real frame", drawn("found", "What each detector finds (orange); labelled cars in green")),
            turned,
        ],
        scenes=scenes,
    )


def draw_kinds(loop: Loop, scenes: Mapping[str, Sequence[Scene]]) -> dict[str, Rgb]:
    """One frame of the renderer as each kind of cloud, labelled; nothing where no frame is in all of them."""
    kinds, span = loop.config.kinds, loop.config.detector.voxels.range_m
    shared = set.intersection(*({scene.name for scene in scenes[kind]} for kind in kinds))
    if not shared:
        return {}
    name = max((scene for scene in scenes[kinds[0]] if scene.name in shared), key=count_objects).name
    nothing = Detected(np.zeros((0, 7), np.float32), np.zeros(0, np.float32))
    panels = []
    for kind in kinds:
        scene = next(s for s in scenes[kind] if s.name == name)
        panels.append(_panel(scene, span, nothing, title=f"{kind}: {len(scene.points)} points"))
    return {"clouds": _grid(panels)}


def draw_detections(loop: Loop, real: Scene, detected: Mapping[str, Detected]) -> dict[str, Rgb]:
    """A real frame, and what the detector of each kind of cloud finds in it."""
    span = loop.config.detector.voxels.range_m
    return {"found": _grid([_panel(real, span, detected[kind], title=f"trained on {kind}") for kind in loop.trained])}


def turned_clouds(loop: Loop, real: Scene, detected: Mapping[str, Detected]) -> list[TurnedScene]:
    """The real frame with its labels and what the detector of each kind of cloud finds in it, for the viewer."""
    labelled = real.boxes[real.target]
    return [
        cloud_with_boxes(f"trained on {kind}", real.points, detected=detected[kind].boxes, labelled=labelled)
        for kind in loop.trained
    ]


def _panel(scene: Scene, span: tuple[float, ...], detected: Detected, *, title: str) -> Rgb:
    labelled = scene.boxes[scene.target]
    return draw_above(scene.points, span, detected=detected, labelled=labelled, title=title, height=PANEL)


def _grid(panels: Sequence[Rgb]) -> Rgb:
    """Panels of one size in rows of three."""
    rows = [beside(panels[k : k + 3]) for k in range(0, len(panels), 3)]
    width = max(row.shape[1] for row in rows)
    return np.concatenate([np.pad(row, ((0, 4), (0, width - row.shape[1]), (0, 0))) for row in rows])


def count_objects(scene: Scene) -> int:
    """Labels of a scene that count: of the class, at some difficulty."""
    return int((scene.target & (scene.difficulty >= 0)).sum())
