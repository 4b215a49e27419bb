"""Trains an intensity network, a detector or depth completion: `python train.py [EXPERIMENT] [--flags]`.

EXPERIMENT is a file of configs/ (default: synthetic, the embedded world). Any field is a flag. The run goes to
runs/NAME; the same command again resumes it.
"""

import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from tqdm import tqdm

import configs
import train_depth
from jaxsim import detect, devices
from jaxsim.cli import enable_compilation_cache, parse_experiment, stop_on_error
from jaxsim.config import DepthExperiment, DetectorExperiment, Experiment
from jaxsim.data import open_dataset, select
from jaxsim.data.batches import ahead, batches
from jaxsim.evaluate.detector import experiment_scenes, main_scores, make_find, score_detector
from jaxsim.evaluate.paired import score_pairs
from jaxsim.metrics import Score
from jaxsim.pairs.prepared import prepared
from jaxsim.pix2pix import create_state, ema_generator, load_vgg, make_generate, make_train_step, start_from
from jaxsim.prepare import input_channels
from jaxsim.report import detection_picture, pair_picture, save_picture, write_card, write_detector_card
from jaxsim.runs.metrics_log import Scribe
from jaxsim.runs.run import Checkpoints, DetectorRun, Run, describe, start_run
from jaxsim.simulate.predict import make_batch, make_predict

Tree = Any


@dataclass(frozen=True)
class Training:
    """What the loop needs of an experiment."""

    run: Run | DetectorRun
    steps: int
    save_every: int
    judge_every: int
    state: Tree
    """With its `step`."""
    batches: Callable[[int, int], Iterable[Tree]]
    """Those of steps a to b - 1, on the devices. Batch k depends on (seed, k) alone."""
    step: Callable[[Tree, Tree], tuple[Tree, dict[str, Any]]]
    name: str
    """Of what is used of the state, in checkpoints."""
    used: Callable[[Tree], Tree]
    judge: Callable[[Tree, str], tuple[dict[str, Score], np.ndarray]]
    """Of what is used: validation scores, and a picture under a title."""
    card: Callable[..., None]
    hint: str
    """What to do next with the run's folder."""


def intensity_network(experiment: Experiment, mesh: Any) -> Training:
    data, prepare, settings, optim = experiment.data, experiment.prepare, experiment.run, experiment.optim

    # Perceptual loss: its weights are asked for before time goes into preparation.
    weights = experiment.loss
    vgg = load_vgg(weights.vgg_weights) if weights.perceptual else None
    if vgg is None:
        print("perceptual loss: off (--loss.perceptual 0; the paper's weight is 10)")

    # Data: frames to aligned pairs on the camera's polar window, made once and kept (or by `jaxsim prepare`).
    dataset = open_dataset(data)
    train = prepared(dataset, select(data.train, dataset), data, prepare)
    validation = prepared(dataset, select(data.validation, dataset), data, prepare)
    # Scaled on the host where frames are magnified, or where drives of other calibrations see other windows.
    raster = prepare.network_size if optim.scale_limit or len(train.windows) > 1 else None
    loader = batches(
        train,
        size=optim.batch,
        seed=settings.seed,
        flip=optim.flip,
        scale_limit=optim.scale_limit,
        raster=raster,
        part=jax.process_index(),
        parts=jax.process_count(),
    )
    to_batch = make_batch(prepare, drop_weight=weights.drop_weight, unseen_weight=weights.unseen_weight)

    if optim.epochs:
        optim = replace(optim, steps=optim.epochs * len(train) // optim.batch)
        experiment = replace(experiment, optim=optim)

    # Model: both networks, their optimisers and the averaged generator, one pytree.
    channels = input_channels(prepare)
    predict = make_predict(make_generate(experiment, channels), prepare)

    def judge(params: Tree, title: str) -> tuple[dict[str, Score], np.ndarray]:
        """Scores of the averaged generator."""
        picture = pair_picture(validation[0], np.asarray(predict(params, validation[0])), title=title)
        return score_pairs(predict, params, validation), picture

    return Training(
        run=describe(experiment, dataset.spec, train.record(0).view),
        steps=optim.steps,
        save_every=settings.save_every,
        judge_every=settings.picture_every,
        state=start_from(create_state(experiment, channels, seed=settings.seed), optim.start, experiment),
        batches=lambda a, b: (to_batch(devices.cut(mesh, pairs)) for pairs in ahead(loader, a, b)),
        step=make_train_step(experiment, channels, vgg=vgg, mesh=mesh),
        name="generator",
        used=ema_generator,
        judge=judge,
        card=write_card,
        hint="Scores beside baselines, and pictures",
    )


def detector(experiment: DetectorExperiment, mesh: Any) -> Training:
    data, settings, optim = experiment.data, experiment.run, experiment.optim

    # Data: frames to scenes, made once and kept; objects of all training scenes to paste into others.
    dataset = open_dataset(data)
    train = experiment_scenes(dataset, select(data.train, dataset), experiment)
    validation = experiment_scenes(dataset, select(data.validation, dataset), experiment)
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
    find = make_find(experiment)

    def judge(network: Tree, title: str) -> tuple[dict[str, Score], np.ndarray]:
        """KITTI's average precision."""
        curves, found = score_detector(find, network, validation, experiment)
        return main_scores(curves), detection_picture(validation[0], found[0], experiment.voxels.range_m, title=title)

    return Training(
        run=DetectorRun(experiment, steps, len(train)),
        steps=steps,
        save_every=settings.save_every or epoch,
        judge_every=settings.picture_every or epoch,
        state=detect.create_state(experiment, steps, seed=settings.seed),
        batches=lambda a, b: (devices.cut(mesh, batch) for batch in detect.ahead(loader, a, b)),
        step=detect.make_train_step(experiment, steps, mesh=mesh),
        name="network",
        used=lambda state: state.network,
        judge=judge,
        card=write_detector_card,
        hint="The last epochs' average precision, and pictures",
    )


def main(experiment: Experiment | DetectorExperiment, description: str) -> None:
    settings = experiment.run
    folder = Path(settings.out) / settings.name

    # Devices: all of them share each batch; of several processes the first alone writes.
    if settings.distributed:
        devices.connect()
    mesh = devices.data_mesh(experiment.optim.batch)
    if isinstance(experiment, DetectorExperiment):
        training = detector(experiment, mesh)
    else:
        training = intensity_network(experiment, mesh)

    # Run: a new folder, or the one that the same command began.
    devices.by_first(lambda: start_run(folder, training.run))
    checkpoints, state = Checkpoints(folder, keep=settings.keep) if devices.is_first() else None, training.state
    if checkpoints and checkpoints.latest:
        state = checkpoints.restore("state", state)
        print(f"resuming {folder} at step {checkpoints.latest}")
    state = devices.everywhere(mesh, state)
    start = step = int(state.step)
    scribe = Scribe(folder, start, writes=devices.is_first())

    def save() -> None:
        if checkpoints:
            checkpoints.save(step, **{"state": state, training.name: training.used(state)})

    def judge() -> dict[str, Score]:
        """Validation scores and a picture; meanwhile other processes wait in their step."""
        if not devices.is_first():
            return {}
        scores, picture = training.judge(devices.nearby(training.used(state)), f"step {step}")
        scribe.write(step, {f"validation/{name}": score.value for name, score in scores.items()})
        save_picture(folder / "figures" / f"step_{step:06d}.png", picture)
        bar.write(f"step {step}: validation " + ", ".join(f"{name} {s.value:.4f}" for name, s in scores.items()))
        return scores

    # Loop: a resumed run sees the batches that an uninterrupted one would.
    begun, scores, left_out, told = time.monotonic(), {}, detect.LeftOut(), False
    shown = {"desc": settings.name, "unit": "step", "smoothing": 0.1, "mininterval": 1.0}
    bar = tqdm(total=training.steps, initial=start, disable=not devices.is_first(), **shown)
    try:
        for k, batch in enumerate(training.batches(start, training.steps), start):
            updated, metrics = training.step(state, batch)
            if not bool(metrics["finite"]):
                scribe.stop_on_nan(k + 1, devices.to_host(batch), devices.to_host(metrics))
            state, step, last = updated, k + 1, k + 1 == training.steps
            left_out.see(metrics)
            if step % settings.log_every == 0 or last:
                values = {name: float(value) for name, value in metrics.items() if name != "finite"}
                scribe.write(step, values | left_out.take())
                losses = {name[5:]: f"{value:.3f}" for name, value in values.items() if name.startswith("loss/")}
                bar.set_postfix(losses, refresh=False)
                if (words := left_out.words()) and (last or not told):
                    bar.write(f"step {step}: {words}")
                    told = True
            bar.update()
            if step % training.judge_every == 0 or last:
                scores = judge()
            if step % training.save_every == 0 or last:
                save()
    except KeyboardInterrupt:
        bar.close()
        save()
        lost = f"; {words}" if (words := left_out.words()) else ""
        sys.exit(f"stopped after step {step}, saved in {folder}; the same command resumes{lost}")
    bar.close()

    # Card: what the run is and what it scored.
    if devices.is_first():
        scores = scores or training.judge(devices.nearby(training.used(state)), "")[0]
        training.card(folder, training.run, description, scores, seconds=time.monotonic() - begun)
        print(f"{folder}: {step} steps done. {training.hint}: python eval.py {folder}")
    devices.wait("the end")


if __name__ == "__main__":
    enable_compilation_cache()
    with stop_on_error():
        experiment, description = parse_experiment(configs, sys.argv[1:])
        if isinstance(experiment, DepthExperiment):
            train_depth.main(experiment, description)
        else:
            main(experiment, description)
