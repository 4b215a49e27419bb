"""A trained detector: its scenes, its run's network, what it finds, and what KITTI's evaluation says of that."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jax
import numpy as np
from pydantic import TypeAdapter

from jaxsim.cloud.kitti_tree import label_lines
from jaxsim.config import DataConfig, DetectorExperiment
from jaxsim.detect.batches import in_range, inside
from jaxsim.detect.published import load_published
from jaxsim.detect.results import Detected, result_lines, write_lines
from jaxsim.detect.scenes import Scene, Scenes, cached_scenes
from jaxsim.detect.steps import Network, make_detect, network_shapes
from jaxsim.files import file_of, placed
from jaxsim.frame import Boxes
from jaxsim.geometry import pad_points, room_for
from jaxsim.geometry.boxes import lidar_boxes
from jaxsim.metrics import Score
from jaxsim.metrics.detection import Curve, evaluate, read_detections, read_truth
from jaxsim.progress import Progress
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints, load_run

_log = logging.getLogger(__name__)

STEP_POINTS = 8192
"""Clouds are filled up to multiples of this, so that few sizes are compiled."""
UNKNOWN = 3
"""KITTI's `occluded` beyond every difficulty."""
Find = Callable[[Network, np.ndarray], tuple[Detected, dict[str, int]]]


def experiment_scenes(dataset: Any, positions: Sequence[int], experiment: DetectorExperiment) -> Scenes:
    """Scenes at these positions of a data set (jaxsim.data), as an experiment sees them; kept in `data.cache`.

    Frames without labels are left out, and it is said how many. Raises ValueError where none has labels.
    """
    data = experiment.data
    scenes = cached_scenes(
        dataset,
        positions,
        experiment.detector.anchors.kind,
        in_image=experiment.in_image,
        cache=data.cache,
        settings=TypeAdapter(DataConfig).dump_json(data.bare).decode(),
    )
    labelled = [file for file, scene in zip(scenes.files, scenes, strict=True) if scene.labels is not None]
    if not labelled:
        raise ValueError(f"detect: none of the {len(scenes)} frames has labels; choose labelled frames")
    if len(labelled) < len(scenes):
        _log.info(f"detect: {len(scenes) - len(labelled)} of {len(scenes)} frames have no labels and are left out")
    return Scenes(labelled)


def make_find(experiment: DetectorExperiment) -> Find:
    """(network, points (n, 4) of one cloud) -> detections, and how many voxels and sites were left out, by stage.

    Clouds of any size; those whose padded size is new are compiled first.
    """
    detect, voxels = make_detect(experiment), experiment.voxels

    def find(network: Network, points: np.ndarray) -> tuple[Detected, dict[str, int]]:
        # Points that no voxel takes would only make the padded size, and so the program, another.
        points = points[in_range(points, voxels)]
        padded, real = pad_points(points, room_for(len(points), STEP_POINTS))
        # A batch of one: clouds differ in size, and each size is a program of its own.
        detections, dropped = detect(network, padded[None], real[None])
        detections, dropped = jax.tree.map(np.asarray, (detections, dropped))
        valid = detections.valid[0]
        detected = Detected(detections.boxes[0][valid], detections.score[0][valid])
        return detected, {name: int(count[0]) for name, count in dropped.items() if count[0]}

    return find


def find_all(
    find: Find,
    network: Network,
    clouds: Iterable[tuple[str, np.ndarray]],
    *,
    total: int,
    quiet: bool = False,
    more_room: str = "training makes room with --voxels.max-voxels and --voxels.growth",
) -> Iterator[tuple[str, Detected]]:
    """Detections cloud by cloud; says at the end where voxels or sites were left out, and `more_room`, what helps."""
    left_out: dict[str, dict[str, int]] = {}
    for name, points in Progress(clouds, total=total, desc="detecting", unit="cloud", disable=quiet, leave=False):
        detected, dropped = find(network, points)
        if dropped:
            left_out[name] = dropped
        yield name, detected
    if left_out:
        # One line for all of them, with the worst: what helps that one helps the others.
        name, dropped = max(left_out.items(), key=lambda item: sum(item[1].values()))
        worst = ", ".join(f"{count} of {stage}" for stage, count in dropped.items())
        _log.info(
            f"detect: {len(left_out)} of {total} clouds had more voxels or sites than there is room for; worst {name}: "
            f"{worst} left out; {more_room}"
        )


def scored_labels(scene: Scene, experiment: DetectorExperiment) -> Boxes:
    """The labels that a scene is scored by: where `scored` is `inside`, those outside the range are `UNKNOWN`.

    KITTI ignores them in every metric, found or not; a DontCare region would excuse what is found in the image alone.
    Hidden shares (fractions in `occluded`) become the levels of the same difficulty, 0 or 1: the official evaluation
    reads no fractions. Raises ValueError for a scene without labels.
    """
    labels = scene.labels
    if labels is None:
        raise ValueError(f"detect: {scene.name} has no labels to be scored by; choose labelled frames")
    # Upwards: a share of 0 alone is easy, any other up to 1 is moderate.
    labels = replace(labels, occluded=np.ceil(labels.occluded).astype(np.int32))
    if experiment.scored == "all":
        return labels
    near = inside(lidar_boxes(labels, scene.view.rect_from_velo), experiment.voxels)
    return replace(labels, occluded=np.where(near, labels.occluded, UNKNOWN))


def kitti_curves(scenes: Sequence[Scene], detected: Sequence[Detected], experiment: DetectorExperiment) -> list[Curve]:
    """KITTI's curves of an experiment's class, by the official rules.

    Raises ValueError, with the scene's name, for labels and detections that are not finite.
    """
    kind = experiment.detector.anchors.kind
    # By way of files: what is scored is what the official tool would read, its decimals included.
    with TemporaryDirectory() as folder:
        labels, results = Path(folder) / "label_2", Path(folder) / "results"
        names = [f"{k:06d}" for k in range(len(scenes))]
        for name, scene, detections in zip(names, scenes, detected, strict=True):
            truth = scored_labels(scene, experiment)
            # An error of these files would name one that nobody has.
            with placed(f"detect: {scene.name}"):
                lines = label_lines(truth)
            _check_finite(scene.name, detections)
            write_lines(file_of(labels, name, ".txt", by="eval"), lines)
            write_lines(file_of(results, name, ".txt", by="eval"), result_lines(detections, kind, scene.view))
        return evaluate(read_truth(labels, names), read_detections(results, names), classes=(kind,))


def _check_finite(name: str, detected: Detected) -> None:
    broken = np.flatnonzero(~np.isfinite(np.column_stack([detected.boxes, detected.score])).all(axis=1))
    if len(broken):
        raise ValueError(
            f"detect: {len(broken)} of {len(detected.score)} detections in {name} are not finite, the first "
            f"{detected.boxes[broken[0]].tolist()} with score {detected.score[broken[0]]:g}: a diverged network writes "
            "such; use an earlier checkpoint"
        )


def main_scores(curves: Sequence[Curve]) -> dict[str, Score]:
    """AP R40 in space and from above at the first set of overlaps, by difficulty; count: labels."""
    return {
        f"AP_{curve.metric}_{curve.difficulty}": Score(curve.ap_r40, "%", curve.truths)
        for curve in curves
        if curve.metric in ("3d", "bev") and curve.overlap_set == "0.7" and curve.truths
    }


def score_detector(
    find: Find, network: Network, scenes: Sequence[Scene], *, experiment: DetectorExperiment
) -> tuple[list[Curve], list[Detected]]:
    """What a network finds in scenes, and KITTI's curves of it."""
    clouds = ((scene.name, scene.points) for scene in scenes)
    detected = [detections for _, detections in find_all(find, network, clouds, total=len(scenes), quiet=True)]
    return kitti_curves(scenes, detected, experiment), detected


@dataclass(frozen=True)
class LearnedDetector:
    """A detector with everything that its use needs."""

    experiment: DetectorExperiment
    network: Network

    def capped(self, max_voxels: int | None) -> LearnedDetector:
        """The detector with another cap on voxels than its own, where one is given."""
        if not max_voxels:
            return self
        voxels = replace(self.experiment.voxels, max_voxels=max_voxels)
        return replace(self, experiment=replace(self.experiment, voxels=voxels))


def load_detector(path: Path | str, *, step: int | None = None) -> LearnedDetector:
    """The detector of a run's folder at its latest checkpoint, or at `step`; or published weights (.npz).

    Raises ValueError for a step that is not kept.
    """
    path = Path(path)
    if path.suffix == ".npz":
        return LearnedDetector(DetectorExperiment(), load_published(path))
    run, checkpoints = load_run(path, DetectorRun), Checkpoints(path)
    if step is not None and step not in checkpoints.steps:
        steps = ", ".join(map(str, checkpoints.steps)) or "none"
        raise ValueError(f"run: {path} keeps no checkpoint of step {step}; it keeps {steps}")
    return LearnedDetector(run.experiment, checkpoints.restore("network", network_shapes(run.experiment), step=step))


def mean_curves(per_epoch: Sequence[Sequence[Curve]]) -> dict[tuple[str, str, str], tuple[float, float]]:
    """Mean and standard deviation of AP R40 over epochs, by metric, overlap set and difficulty."""
    values: dict[tuple[str, str, str], list[float]] = {}
    for curves in per_epoch:
        for curve in curves:
            values.setdefault((curve.metric, curve.overlap_set, curve.difficulty), []).append(curve.ap_r40)
    return {key: (float(np.mean(aps)), float(np.std(aps))) for key, aps in values.items()}
