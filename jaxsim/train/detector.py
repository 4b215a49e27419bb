"""The training of a detector: scenes with pasted objects, Voxel R-CNN's two stages."""

from __future__ import annotations

import jax
from jaxtyping import PyTree

from jaxsim import detect, devices
from jaxsim.config import DetectorExperiment
from jaxsim.data import open_dataset, select
from jaxsim.data.seen import SplitSide, warn_of_seen
from jaxsim.detect.scenes import Scenes
from jaxsim.evaluate.detector import experiment_scenes, main_scores, make_find, score_detector
from jaxsim.files import as_argument
from jaxsim.report.clouds import detection_picture
from jaxsim.report.results import list_scores
from jaxsim.runs.frames import RunFrames, check_frames
from jaxsim.runs.kinds import DetectorRun
from jaxsim.train.training import Picture, RunScores, Training, ahead, run_folder


def detector_training(experiment: DetectorExperiment) -> Training:
    """Raises ValueError where frames, labels or objects of the class are missing."""
    data = experiment.data
    settings = experiment.run
    optim = experiment.optim
    mesh = devices.data_mesh(optim.batch)

    # Data: frames to scenes, made once and kept; objects of all training scenes to paste into others.
    dataset = open_dataset(data)
    chosen, judging = select(data.train, dataset), select(data.validation, dataset)
    folder, frames = run_folder(settings), RunFrames.at(dataset, chosen, validation=judging)
    check_frames(folder, frames)
    train = experiment_scenes(dataset, chosen, experiment)
    validation = experiment_scenes(dataset, judging, experiment)
    warn_of_seen(_side(train), _side(validation), names=[file.stem for file in validation.files])
    loader = detect.SceneBatches(
        train,
        experiment.voxels,
        experiment.augment,
        size=optim.batch,
        seed=settings.seed,
        part=jax.process_index(),
        parts=jax.process_count(),
    )
    epoch = loader.steps_per_epoch
    steps = optim.epochs * epoch

    # Model: both stages and their optimiser, one pytree.
    train_step = detect.make_train_step(experiment, steps, mesh=mesh)
    find = make_find(experiment)

    def validate(network: PyTree, step: int) -> tuple[RunScores, Picture]:
        """KITTI's average precision."""
        curves, scored = score_detector(find, network, validation, experiment=experiment)
        picture = detection_picture(validation[0], scored[0], experiment.voxels.range_m, title=f"step {step}")
        return main_scores(curves), picture

    return Training(
        run=DetectorRun(experiment, steps, len(train)),
        frames=frames,
        steps=steps,
        save_every=settings.save_every or epoch,
        judge_every=settings.picture_every or epoch,
        state=detect.create_state(experiment, steps, seed=settings.seed),
        mesh=lambda k: mesh,
        batches=lambda a, b: (devices.cut(mesh, batch) for batch in ahead(loader, a, b)),
        step=lambda state, batch, k: train_step(state, batch),
        network="network",
        used=lambda state: state.network,
        validate=validate,
        facts=(
            f"data: {data.kind}, frames {data.train} (validation {data.validation})",
            f"class: {experiment.detector.anchors.kind}",
            f"{len(train)} scenes, {optim.epochs} epochs, {optim.batch} scenes a step",
        ),
        scored=lambda scores: (
            "Validation, last step (AP is average precision over 40 recalls, KITTI's rules):\n\n" + list_scores(scores)
        ),
        use=f"```\njaxsim detect {as_argument(folder)} --clouds FOLDER --out OUT\n```",
        hint=f"The last epochs' average precision, and pictures: jaxsim eval {as_argument(folder)}",
    )


def _side(scenes: Scenes) -> SplitSide:
    """The scenes as a side of a split."""
    return SplitSide(scenes.files, lambda i: [scenes[i].points])
