"""The ablation of inputs for people: the paper's table with ours beside it, strips of pictures, one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from jaxsim.evaluate.fid import frechet_line
from jaxsim.frame import Painted, PolarImage
from jaxsim.metrics import Score
from jaxsim.prepare import edge_map
from jaxsim.report.canvas import data_uri
from jaxsim.report.frames import Raster, input_panels, intensity_panel
from jaxsim.report.markdown import markdown_table
from jaxsim.report.page import paragraph, section, table, whole_page
from jaxsim.report.pictures import NOTHING, beside, strip
from jaxsim.report.results import list_facts, write_results
from jaxsim.studies.ablation.table import PAPER_FID, AblationRow

Rgb = UInt8[np.ndarray, "h w 3"]
Baselines = Mapping[str, dict[str, Score]]
SMALL = ("mae", "rmse", "frechet")
"""Scores of which the smallest is best; of the others the largest."""


def ablation_picture(painted: Painted, predicted: Mapping[str, Raster], measured: PolarImage | None) -> Rgb:
    """Left: the inputs, and what was measured, where something was. Right: every network's intensity."""
    valid = np.asarray(painted.valid)
    edges = np.asarray(edge_map(painted.semantic, painted.instance)) & valid
    white = np.where(edges[..., None], np.uint8(235), NOTHING)
    inputs = [*input_panels(painted), ("edges", white)]
    if measured is not None:
        inputs.append(
            ("measured intensity", intensity_panel(np.asarray(measured.intensity), np.asarray(measured.valid)))
        )
    outputs = [(name, intensity_panel(np.asarray(image), valid)) for name, image in predicted.items()]
    return beside([strip(panels, width=744) for panels in (inputs, outputs)])


def ablation_table(rows: Sequence[AblationRow], baselines: Baselines) -> str:
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
    baselines: Baselines,
    *,
    pictures: Mapping[str, Rgb],
    about: Mapping[str, str],
) -> Path:
    """Writes ablation.json, ablation.md and ablation.html, self-contained; gives the page. `about`: facts to print."""
    content = {
        "about": dict(about),
        "rows": [_plain(row) | {"paper_fid": PAPER_FID.get(row.name)} for row in rows],
        "baselines": {who: {name: score._asdict() for name, score in row.items()} for who, row in baselines.items()},
    }
    text = f"{list_facts(about)}\n\n{ablation_table(rows, baselines)}\n\n{_notes(rows)}"
    return write_results(folder, "ablation", content, text=text, page=_page(rows, baselines, pictures, about))


def _plain(row: AblationRow) -> dict[str, object]:
    frechet = asdict(row.frechet) if row.frechet else None
    scores = {name: score._asdict() for name, score in row.scores.items()}
    return {"name": row.name, "inputs": row.inputs, "scores": scores, "frechet": frechet}


def _cells(rows: Sequence[AblationRow], baselines: Baselines) -> tuple[list[str], list[list[tuple[str, bool]]]]:
    """Heads, and for each row its cells' text and whether a network is the best there."""
    best, first = best_networks(rows), rows[0]
    names = list(first.scores)
    distance = [first.frechet.name] if first.frechet else []
    heads = ["inputs", "FID in the paper", *distance]
    heads += [n if first.scores[n].unit == "1" else f"{n} ({first.scores[n].unit})" for n in names]

    def score(row: dict[str, Score], who: str | None) -> list[tuple[str, bool]]:
        return [(f"{row[n].value:.{2 if row[n].unit == 'dB' else 4}f}", best[n] == who) for n in names]

    cells = []
    for row in rows:
        paper = f"{PAPER_FID[row.name]:.2f}" if row.name in PAPER_FID else "-"
        ours = [(f"{row.frechet.value:.2f}", best["frechet"] == row.name)] if row.frechet else []
        cells.append([(row.name, False), (paper, False), *ours, *score(row.scores, row.name)])
    for name, baseline in baselines.items():
        cells.append([(name, False), ("-", False), *[("-", False)] * len(distance), *score(baseline, None)])
    return heads, cells


def _notes(rows: Sequence[AblationRow]) -> str:
    lines = [f"{row.name}: {frechet_line(row.frechet)}" for row in rows if row.frechet]
    lines.append(
        "The paper's column is FID on KITTI-STEP after 20 epochs. Another extractor, set or number of images gives "
        "other values; only the order can be compared."
    )
    return "\n".join(lines)


def _sentence(rows: Sequence[AblationRow]) -> str:
    best = best_networks(rows)
    told = [("mae", "error of intensity")] + ([("frechet", rows[0].frechet.name)] if rows[0].frechet else [])
    text = " and ".join(f"{best[key] or 'no single network'} has the least {words}" for key, words in told)
    return f"{text[0].upper()}{text[1:]} of {len(rows)} networks."


def _page(
    rows: Sequence[AblationRow], baselines: Baselines, pictures: Mapping[str, Rgb], about: Mapping[str, str]
) -> str:
    heads, cells = _cells(rows, baselines)
    body = [[f"<b>{escape(text)}</b>" if best else escape(text) for text, best in row] for row in cells]
    notes = "".join(paragraph(line) for line in _notes(rows).splitlines())
    figures = "".join(
        f'<figure><img src="{data_uri(picture)}" style="width:100%" alt="inputs and predictions of {escape(name)}">'
        f"<figcaption>{escape(name)}</figcaption></figure>"
        for name, picture in pictures.items()
    )
    return whole_page(
        title="jaxsim: which inputs the intensity network needs",
        sentence=_sentence(rows),
        facts=list(about.items()),
        sections=[
            section("Scores", table(heads, body, text=1) + notes),
            section(
                "Frames",
                paragraph("Left: what the camera knows, and the sensor's answer. Right: each network's.") + figures,
            ),
        ],
    )
