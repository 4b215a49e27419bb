"""The training of depth completion: PENet's three stages, one after the other, in one run.

At the end the run also holds weights.npz, for `--prepare.depth penet --prepare.depth-weights`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh
from jaxtyping import PyTree

from jaxsim import devices
from jaxsim.config import DepthExperiment, Part, PenetConfig, Stage
from jaxsim.data import Dataset, open_dataset, select
from jaxsim.data.kitti_depth import KittiDepth
from jaxsim.data.seen import SplitSide, warn_of_seen
from jaxsim.frame import DepthFrame
from jaxsim.metrics.depth import benchmark_errors, depth_scores, interpolate_background
from jaxsim.prepare.depth.penet import NEAREST_M, save_penet
from jaxsim.prepare.depth.penet.training import (
    Batches,
    begin_stage,
    branch_weight,
    check_sizes,
    create_state,
    depth_frame,
    predict,
    rate,
    train_step,
    where_backed,
)
from jaxsim.progress import Progress
from jaxsim.report.pictures import depth_picture
from jaxsim.runs.frames import RunFrames, check_frames
from jaxsim.runs.kinds import DepthRun
from jaxsim.train.training import Batch, Picture, RunScores, Training, ahead, run_folder

_log = logging.getLogger(__name__)

THREADS = 4
FRAMES_BETWEEN = 4
"""Validation frames that are scored between the stages' ends; all are at the end."""


class Rendered(Sequence[DepthFrame]):
    """Frames of a renderer by position, each made once and kept in memory: a few hundred, 6 MB each."""

    def __init__(self, dataset: Dataset, positions: Sequence[int], *, crop: tuple[int, int]):
        self.dataset = dataset
        self.positions = positions
        self.crop = crop
        self.kept: dict[int, DepthFrame] = {}
        self.lock = Lock()  # several threads ask: one makes a frame, the others wait for it

    def __len__(self) -> int:
        return len(self.positions)

    def name_of(self, index: int) -> str:
        """The frame's name in its data set."""
        return self.dataset.name_of(self.positions[index])

    def __getitem__(self, i):
        with self.lock:
            if i not in self.kept:
                frame = self.dataset[self.positions[i]]
                self.kept[i] = where_backed(depth_frame(frame, self.crop))
            return self.kept[i]


def frames_of(experiment: DepthExperiment) -> tuple[KittiDepth | Rendered, KittiDepth | Rendered]:
    """Training and validation frames; KITTI's are read whenever they are asked for, as 92 750 do not fit into memory.

    Raises ValueError where the data set has no true depth, or a part of it is missing.
    """
    data = experiment.data
    crop = experiment.image_crop
    judged = experiment.depth_validation
    if experiment.depth_root is not None:
        train = KittiDepth(experiment.depth_root, data.root, part="train", crop=crop)
        return train, KittiDepth(judged or experiment.depth_root, data.root, part="val", crop=crop)
    if judged is not None:
        raise ValueError(
            f"penet: --depth-validation {judged} goes with --depth-root, the folder of KITTI's depth completion set "
            "that holds train/; other data are chosen by --data.validation"
        )
    dataset = open_dataset(data)
    learned, judging = select(data.train, dataset), select(data.validation, dataset)
    warn_of_seen(SplitSide(learned), SplitSide(judging), names=[dataset.name_of(i) for i in judging])
    return Rendered(dataset, learned, crop=crop), Rendered(dataset, judging, crop=crop)


def depth_training(experiment: DepthExperiment) -> Training:
    """Raises ValueError where the network cannot take a crop, or frames or their true depth are missing."""
    config, settings = experiment.penet, experiment.run
    check_sizes(experiment)
    if settings.distributed:
        raise ValueError("penet: depth completion is trained by one process, on all its devices: no --run.distributed")
    meshes = tuple(devices.data_mesh(stage.batch) for stage in config.stages)

    # Data: the crop of each frame, its sparse depth and its truth.
    train, validation = frames_of(experiment)
    folder = run_folder(settings)
    frames = RunFrames(*(tuple(map(part.name_of, range(len(part)))) for part in (train, validation)))
    check_frames(folder, frames, by="--data.train" if experiment.depth_root is None else "--depth-root")

    # Model: the stage's part of it learns, at the epoch's rate.
    stages = PenetStages(config, Batches(train, config, settings.seed), meshes)
    steps = len(stages.loader)

    def validate(values: PyTree, step: int, *, count: int = FRAMES_BETWEEN) -> tuple[RunScores, Picture]:
        part = stages.stage_of(step - 1).part
        return score_frames(values, validation, config, part=part, step=step, count=count)

    def finish(values: PyTree) -> RunScores:
        """Writes the weights for preparation; scores all validation frames."""
        save_penet(folder / "weights.npz", devices.to_host(values))
        return validate(values, steps, count=len(validation))[0]

    def scored(scores: RunScores) -> str:
        lines = (f"- {n}: {s.value:.4g} {s.unit} ({s.count} of {len(validation)} images)" for n, s in scores.items())
        return "\n".join(lines) or "- not one validation image could be scored"

    use = f"--prepare.depth penet --prepare.depth-weights {folder}/weights.npz"
    return Training(
        run=DepthRun(experiment),
        frames=frames,
        steps=steps,
        save_every=settings.save_every,
        judge_every=settings.picture_every,
        state=create_state(config, settings.seed),
        mesh=stages.mesh_of,
        batches=stages.batches,
        step=stages.step,
        network="network",
        used=lambda state: state.values,
        validate=validate,
        facts=(),
        scored=scored,
        use=f"`{use}`",
        hint=f"Use: {use}",
        milestones=frozenset(map(int, stages.loader.ends)),
        finish=finish,
    )


@dataclass(frozen=True)
class PenetStages:
    """What learns from each batch, at which rate and on which devices."""

    config: PenetConfig
    loader: Batches
    meshes: tuple[Mesh | None, ...]
    """Of each stage; None where one device takes its batches whole."""

    def stage_of(self, k: int) -> Stage:
        """The stage of batch k; past the end, the last."""
        return self.config.stages[self._number_of(k)]

    def mesh_of(self, k: int) -> Mesh | None:
        """The devices that share batch k."""
        return self.meshes[self._number_of(k)]

    def batches(self, a: int, b: int) -> Iterator[Batch]:
        """Batches a to b - 1, on the devices."""
        for k, crops in enumerate(ahead(self.loader, a, b, threads=THREADS), a):
            yield vars(devices.cut(self.mesh_of(k), crops))

    def step(self, state: PyTree, batch: Batch, k: int) -> tuple[PyTree, dict[str, Any]]:
        """The update by batch k."""
        number, epoch, index = self.loader.place(k)
        stage = self.config.stages[number]
        if k and epoch == index == 0:  # each stage has an optimiser of its own, and devices that divide its batch
            state = devices.everywhere(self.meshes[number], devices.nearby(begin_stage(state, self.config)))
        return train_step(
            state,
            DepthFrame(**batch),
            np.float32(rate(self.config, stage, epoch)),
            weight=np.float32(branch_weight(epoch)),
            config=self.config,
            part=stage.part,
            norms=stage.norms,
        )

    def _number_of(self, k: int) -> int:
        return self.loader.place(min(k, len(self.loader) - 1))[0]


def score_frames(
    values: PyTree, frames: Sequence[DepthFrame], config: PenetConfig, *, part: Part, step: int, count: int
) -> tuple[RunScores, Picture]:
    """KITTI's scores of the first `count` frames, after this step of a stage that trains `part`; and a picture of the
    very first."""
    count = min(count, len(frames))
    errors, picture = [], np.zeros((1, 1, 3), np.uint8)
    for i in Progress(range(count), desc="validation", unit="image", leave=False, disable=count <= FRAMES_BETWEEN):
        frame = frames[i]
        batch = jax.tree.map(lambda x: np.asarray(x)[None], frame)
        guess = np.asarray(predict(values, batch, config=config, part=part))[0]
        guessed = np.isfinite(guess) & (guess > NEAREST_M)
        guess = np.where(guessed, guess, np.float32(0))
        if i == 0:
            picture = depth_picture(frame, [(f"step {step}", guess, guessed)])
        if frame.known.any() and not (frame.known & ~interpolate_background(guess, guessed)[1]).any():
            errors.append(benchmark_errors(guess, guessed, frame.truth_m, known=frame.known))
    if len(errors) < count:
        _log.info(
            f"step {step}: {count - len(errors)} of {count} validation images not scored: no truth, or rows of it "
            f"where no depth exceeds {NEAREST_M} m"
        )
    return depth_scores(errors) if errors else {}, picture
