"""The ablation of inputs for people: the paper's first table with ours beside it, strips of pictures, one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from jaxsim.evaluate.intensity import frechet_line
from jaxsim.frame import Painted, PolarImage
from jaxsim.metrics import Score
from jaxsim.metrics.frechet import FrechetScore
from jaxsim.prepare import edge_map
from jaxsim.report.page import figure, image, paragraph, section, table, together, whole_page
from jaxsim.report.pictures import NOTHING, Raster, Rgb, beside, input_panels, intensity_panel, strip
from jaxsim.report.results import (
    Scores,
    list_facts,
    markdown_table,
    plain_scores,
    score_heads,
    score_text,
    write_results,
)

SMALL = ("mae", "rmse", "frechet")
"""Scores of which the smallest is best; of the others the largest."""
PAPER_FID = {"rgb": 89.44, "semantic": 77.01, "edges": 102.61, "depth": 81.43, "combined": 73.81}
"""FID that the paper's first table gives, after 20 epochs on KITTI-STEP."""


@dataclass(frozen=True)
class AblationRow:
    """One network of the table."""

    name: str
    inputs: tuple[str, ...]
    scores: dict[str, Score]
    """Scores by cell: `mae`, `rmse`, `psnr`, `ssim`, `drop_iou`, `drop_f1`."""
    frechet: FrechetScore | None
    """Fréchet distance between predicted and measured images; None where none was asked for."""


def ablation_picture(painted: Painted, predicted: Mapping[str, Raster], measured: PolarImage | None) -> Rgb:
    """Left: the inputs, and what was measured, where something was. Right: every network's intensity."""
    valid = np.asarray(painted.valid)
    edges = np.asarray(edge_map(painted.semantic, painted.instance)) & valid
    white = np.where(edges[..., None], np.uint8(235), NOTHING)
    inputs = [*input_panels(painted), ("edges", white)]
    if measured is not None:
        panel = intensity_panel(np.asarray(measured.intensity), np.asarray(measured.valid))
        inputs.append(("measured intensity", panel))
    outputs = [(name, intensity_panel(np.asarray(intensity), valid)) for name, intensity in predicted.items()]
    return beside([strip(panels, width=744) for panels in (inputs, outputs)])


def ablation_table(rows: Sequence[AblationRow], baselines: Scores) -> str:
    """Markdown: a row a network, the paper's FID beside our scores, the best network in bold; then the baselines."""
    heads, cells = _cells(rows, baselines)
    return markdown_table(heads, [[f"**{text}**" if best else text for text, best in row] for row in cells])


def best_networks(rows: Sequence[AblationRow]) -> dict[str, str]:
    """Score -> the name of the network that is best in it; empty where two are equally good."""
    values = {row.name: {name: score.value for name, score in row.scores.items()} for row in rows}
    for row in rows:
        if row.frechet:
            values[row.name]["frechet"] = row.frechet.value
    best = {}
    for name in values[rows[0].name]:
        column = {who: own[name] * (1 if name in SMALL else -1) for who, own in values.items()}
        first = [who for who, value in column.items() if value == min(column.values())]
        best[name] = first[0] if len(first) == 1 else ""
    return best


def write_ablation(
    folder: Path,
    rows: Sequence[AblationRow],
    baselines: Scores,
    *,
    pictures: Mapping[str, Rgb],
    about: Mapping[str, str],
) -> Path:
    """Writes ablation.json, ablation.md and ablation.html, self-contained; gives the page. `about`: facts to print."""
    content = {
        "about": dict(about),
        "rows": [
            {
                "name": row.name,
                "inputs": row.inputs,
                "scores": plain_scores(row.scores),
                "frechet": asdict(row.frechet) if row.frechet else None,
                "paper_fid": PAPER_FID.get(row.name),
            }
            for row in rows
        ],
        "baselines": {who: plain_scores(row) for who, row in baselines.items()},
    }
    text = f"{list_facts(about)}\n\n{ablation_table(rows, baselines)}\n\n{_notes(rows)}"
    page = _page(rows, baselines, pictures=pictures, about=about)
    return write_results(folder, "ablation", content, text=text, page=page)


def _cells(rows: Sequence[AblationRow], baselines: Scores) -> tuple[list[str], list[list[tuple[str, bool]]]]:
    """Heads, and for each row its cells' text and whether a network is the best there."""
    best, first = best_networks(rows), rows[0]
    distance = [first.frechet.name] if first.frechet else []
    heads = ["inputs", "FID in the paper", *distance, *score_heads(first.scores)]

    def score(row: Mapping[str, Score], who: str | None) -> list[tuple[str, bool]]:
        return [(score_text(row[name]), best[name] == who) for name in first.scores]

    cells = []
    for row in rows:
        paper = f"{PAPER_FID[row.name]:.2f}" if row.name in PAPER_FID else "-"
        ours = [(f"{row.frechet.value:.2f}", best["frechet"] == row.name)] if row.frechet else []
        cells.append([(row.name, False), (paper, False), *ours, *score(row.scores, row.name)])
    for name, baseline in baselines.items():
        cells.append([(name, False), ("-", False), *[("-", False)] * len(distance), *score(baseline, None)])
    return heads, cells


def _notes(rows: Sequence[AblationRow]) -> str:
    paper = (
        "The paper's column is FID on KITTI-STEP after 20 epochs. Another extractor, set or number of images gives "
        "other values; only the order can be compared."
    )
    return "\n".join([*(f"{row.name}: {frechet_line(row.frechet)}" for row in rows if row.frechet), paper])


def _sentence(rows: Sequence[AblationRow]) -> str:
    best = best_networks(rows)
    told = [("mae", "error of intensity")] + ([("frechet", rows[0].frechet.name)] if rows[0].frechet else [])
    text = " and ".join(f"{best[key] or 'no single network'} has the least {words}" for key, words in told)
    return f"{text[0].upper()}{text[1:]} of {len(rows)} networks."


def _page(
    rows: Sequence[AblationRow], baselines: Scores, *, pictures: Mapping[str, Rgb], about: Mapping[str, str]
) -> str:
    heads, cells = _cells(rows, baselines)
    body = [[Markup("<b>{}</b>").format(text) if best else text for text, best in row] for row in cells]
    notes = together(paragraph(line) for line in _notes(rows).splitlines())
    sides = paragraph("Left: what the camera knows, and the sensor's answer. Right: each network's.")
    figures = together(
        figure(image(picture, f"inputs and predictions of {name}"), name) for name, picture in pictures.items()
    )
    return whole_page(
        title="jaxsim: which inputs the intensity network needs",
        sentence=_sentence(rows),
        facts=list(about.items()),
        sections=[section("Scores", table(heads, body, text=1) + notes), section("Frames", sides + figures)],
    )
