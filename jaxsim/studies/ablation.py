"""The paper's first table: networks that differ in their inputs alone, trained, judged on the same frames, drawn; for
people the table with ours beside it, strips of pictures, one page.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from jaxsim.config import DataConfig, Experiment, InputName
from jaxsim.config.ranges import settings_of
from jaxsim.data import open_dataset, select
from jaxsim.evaluate.intensity import baseline_sums, frechet_line, frechet_of_run, score_pairs
from jaxsim.frame import Painted, PolarImage
from jaxsim.metrics import Score
from jaxsim.metrics.frechet import FrechetScore, require_images
from jaxsim.metrics.inception import Extractor
from jaxsim.metrics.paired import total_scores
from jaxsim.pairs.prepared import prepared
from jaxsim.prepare import edge_map
from jaxsim.report.page import figure, section, table, whole_page
from jaxsim.report.pictures import NO_RETURN, Raster, Rgb, beside, input_panels, intensity_panel, save_pictures, strip
from jaxsim.report.results import Scores, list_facts, markdown_table, score_heads, score_text, write_results
from jaxsim.runs.frames import judges_of, positions_of, shared_frames
from jaxsim.simulate.frames import simulate_batch, take
from jaxsim.simulate.learned_sensor import LearnedSensor, load
from jaxsim.simulate.predict import make_predict
from jaxsim.train.loop import TRAINER, train_apart

_log = logging.getLogger(__name__)

MODALITIES: dict[str, tuple[InputName, ...]] = {
    "rgb": ("rgb",),
    "semantic": ("semantic",),
    "edges": ("edges",),
    "depth": ("depth",),
    "combined": ("rgb", "depth", "semantic", "edges"),
}
"""The five networks of the paper, by the names of its table."""
SMALLEST_BEST = ("mae", "rmse", "frechet")
"""Scores of which the smallest is best; of the others the largest."""
PAPER_FID = {"rgb": 89.44, "semantic": 77.01, "edges": 102.61, "depth": 81.43, "combined": 73.81}
"""FID that the paper's first table gives, after 20 epochs on KITTI-STEP."""


def besides(inputs: Sequence[InputName]) -> tuple[InputName, ...]:
    """The inputs that the paper has not, as the laser line: every network of a table has the same of them."""
    return tuple(name for name in inputs if name not in MODALITIES["combined"])


def modality(inputs: Sequence[InputName]) -> str:
    """The name of a network by the paper's inputs that it has: the paper's name, or the inputs themselves."""
    of_camera = [name for name in inputs if name in MODALITIES["combined"]]
    return next(
        (name for name, paper in MODALITIES.items() if set(of_camera) == set(paper)), "+".join(of_camera) or "none"
    )


def named_networks(networks: Mapping[str, LearnedSensor]) -> dict[str, LearnedSensor]:
    """Networks by the name of their inputs, those of the paper in its order, then others as they were given.

    `networks` are by the name of their run. Raises ValueError for two networks of the same inputs, and for runs that
    learned from other frames, targets or windows, naming the settings that differ.
    """
    first = next(iter(networks))
    reference = _compared(networks[first].run.experiment)
    named: dict[str, LearnedSensor] = {}
    for run, network in networks.items():
        settings = _compared(network.run.experiment)
        if other := [key for key in settings if settings[key] != reference[key]]:
            differences = ", ".join(f"{key} is {settings[key]!r} and {reference[key]!r}" for key in other)
            raise ValueError(
                f"ablation: {run} and {first} differ in more than their inputs: {differences}; train them alike"
            )
        name = modality(network.run.experiment.prepare.inputs)
        if name in named:
            raise ValueError(f"ablation: two runs have the inputs {name}, one of them is {run}; leave one out")
        named[name] = network
    order = [*MODALITIES, *named]
    return dict(sorted(named.items(), key=lambda item: order.index(item[0])))


def _compared(experiment: Experiment) -> dict[str, Any]:
    """Settings in which runs of one table must agree: all that decides what is learned and how it is used, but for the
    inputs."""
    data = replace(experiment.data, root=experiment.data.root and experiment.data.root.resolve())
    prepare = replace(experiment.prepare, inputs=besides(experiment.prepare.inputs))
    parts = vars(replace(experiment, data=data, prepare=prepare))
    named = {f"{part}.{key}": value for part, config in parts.items() for key, value in vars(config).items()}
    free = [*settings_of(Experiment, "kept", "drawn")]
    return {name: value for name, value in named.items() if name not in free}


def train_all(
    experiment: str, out: Path, flags: Sequence[str], *, more: Sequence[str] = (), trainer: Sequence[str] = TRAINER
) -> list[Path]:
    """Trains the experiment once for each of MODALITIES, with `more` inputs, one after the other; the runs' folders.

    `trainer`, a program, itself resumes, refuses a run of other settings, and has nothing to do for one that is
    finished. Ends the program with its exit status where it fails.
    """
    runs = []
    for name, inputs in reversed(MODALITIES.items()):  # combined first: its pairs have labels and serve all
        _log.info(f"ablation: {name} ({', '.join(inputs)})")
        named = ["--prepare.inputs", *inputs, *more, "--run.name", name, "--run.out", str(out)]
        status = train_apart(experiment, *flags, *named, trainer=trainer)
        if status:
            sys.exit(f"error: ablation: training {name} ended with status {status}; the same command resumes")
        runs.insert(0, out / name)
    return runs


def compare_networks(
    folders: Sequence[Path],
    out: Path,
    *,
    frames: str = "",
    extractor: Extractor | None = None,
    pictures: int = 4,
    unmeasured: tuple[DataConfig, str] | None = None,
) -> None:
    """Judges the networks of runs on the same frames, and writes and prints their table.

    `frames` are those to judge, by default the runs' validation frames; `unmeasured` is a renderer's data set and its
    frames to draw as well. Raises ValueError for runs that cannot be compared, and for too few frames.
    """
    # Runs: the same frames, targets and settings, other inputs.
    networks = named_networks({str(folder): load(folder) for folder in folders})
    experiment = next(iter(networks.values())).run.experiment
    # Judged frames have labels where any of the networks sees them.
    settings = [network.run.experiment.prepare for network in networks.values()]
    prepare = next((s for s in settings if {"semantic", "edges"} & {*s.inputs}), settings[0])
    data = experiment.data
    recorded = shared_frames(folders, by="ablation")
    predicts = {name: make_predict(s.generate, s.run.experiment.prepare) for name, s in networks.items()}

    # Frames: one set for all.
    dataset = open_dataset(data)
    judges = judges_of(recorded, dataset, frames=frames, validation=data.validation)
    judged = prepared(dataset, judges, data, prepare=prepare)
    if extractor:
        require_images(len(judged), extractor.width, name=extractor.score)
    learned = positions_of(recorded and recorded.train, dataset, text=data.train, part="training")
    train = prepared(dataset, learned, data, prepare=prepare)
    sums = baseline_sums(train, judged, [None] * len(judged))
    baselines = {name: total_scores(frames) for name, frames in sums.items()}

    # Scores.
    rows = []
    for name, network in networks.items():
        scores = score_pairs(predicts[name], network.params, judged)
        seen, frechet = network.run.experiment.prepare, None
        if extractor:
            how = {"extractor": extractor, "prepare": seen, "cache": data.cache / "statistics"}
            frechet = frechet_of_run(network.generate, network.params, judged, **how)
        rows.append(AblationRow(name, tuple(seen.inputs), scores, frechet))
        _log.info(f"ablation: {name}: mae {scores['mae'].value:.4f}")

    # Pictures: evenly spread over the frames.
    drawn = {}
    for k in np.unique(np.linspace(0, len(judged) - 1, min(pictures, len(judged))).round().astype(int)).tolist():
        pair = judged[k]
        outputs = {
            name: np.asarray(predicts[name](network.params, pair).reported) for name, network in networks.items()
        }
        drawn[judged.names[k]] = ablation_picture(pair.painted, outputs, pair.measured)
    if unmeasured:
        drawn |= draw_unmeasured(networks, *unmeasured)
    save_pictures(out / "pictures", [(name.replace("/", "_"), one) for name, one in drawn.items()], by="ablation")

    about = {"data": data.kind, "training frames": data.train, "judged frames": str(len(judged))}
    if others := besides(prepare.inputs):
        about["every network also sees"] = ", ".join(others)
    about |= {"updates": str(experiment.optim.steps), "batch": str(experiment.optim.batch)}
    page = write_ablation(out, rows, baselines, pictures=drawn, about=about)
    _log.info(f"\n{ablation_table(rows, baselines)}\n\ntable, page and pictures: {page}")


def draw_unmeasured(networks: Mapping[str, LearnedSensor], source: DataConfig, frames: str) -> dict[str, Rgb]:
    """Pictures of a renderer's frames, which have no measured intensity."""
    dataset = open_dataset(source)
    pictures = {}
    for position in select(frames, dataset):
        frame = dataset[position]
        outputs = {}
        painted = None
        for name, network in networks.items():
            images, painted, _ = simulate_batch(network, [frame], 1)
            image = take(images, 0)
            outputs[name] = image.intensity * image.valid
        pictures[f"{source.kind}: {frame.name}"] = ablation_picture(take(painted, 0), outputs, None)
    return pictures


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
    white = np.where(edges[..., None], np.uint8(235), NO_RETURN)
    inputs = [*input_panels(painted), ("edges", white)]
    if measured is not None:
        panel = intensity_panel(np.asarray(measured.intensity), np.asarray(measured.valid))
        inputs.append(("measured intensity", panel))
    # A network's 0 is a lost ray.
    shown = {name: np.asarray(intensity) for name, intensity in predicted.items()}
    outputs = [(name, intensity_panel(intensity, valid & (intensity > 0))) for name, intensity in shown.items()]
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
        column = {who: by_run[name] * (1 if name in SMALLEST_BEST else -1) for who, by_run in values.items()}
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
        "rows": [vars(row) | {"paper_fid": PAPER_FID.get(row.name)} for row in rows],
        "baselines": baselines,
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
    columns = [("mae", "error of intensity")] + ([("frechet", rows[0].frechet.name)] if rows[0].frechet else [])
    text = " and ".join(f"{best[key] or 'no single network'} has the least {words}" for key, words in columns)
    return f"{text[0].upper()}{text[1:]} of {len(rows)} networks."


def _page(
    rows: Sequence[AblationRow], baselines: Scores, *, pictures: Mapping[str, Rgb], about: Mapping[str, str]
) -> str:
    heads, cells = _cells(rows, baselines)
    body = [[Markup("<b>{}</b>").format(text) if best else text for text, best in row] for row in cells]
    sides = "Left: what the camera knows, and the sensor's answer. Right: each network's."
    figures = [figure(one, name, label=f"inputs and predictions of {name}") for name, one in pictures.items()]
    return whole_page(
        title="jaxsim: which inputs the intensity network needs",
        sentence=_sentence(rows),
        facts=list(about.items()),
        sections=[
            section("Scores", table(heads, body, text=1), *_notes(rows).splitlines()),
            section("Frames", sides, *figures),
        ],
    )
