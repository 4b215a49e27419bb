"""Trains an intensity network: `python train.py [EXPERIMENT] [--flags]`.

EXPERIMENT is a file of configs/ (default: synthetic, the embedded world). Any field is a flag. The run goes to
runs/NAME; the same command again resumes it.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
from tqdm import tqdm

import configs
from jaxsim import devices
from jaxsim.cli import enable_compilation_cache, parse_experiment, stop_on_error
from jaxsim.config import Experiment
from jaxsim.data import open_dataset, select
from jaxsim.data.batches import ahead, batches
from jaxsim.pix2pix import create_state, ema_generator, load_vgg, make_generate, make_train_step, start_from
from jaxsim.prepare import input_channels
from jaxsim.report import pair_picture, save_picture, write_card
from jaxsim.simulate import (
    Checkpoints,
    Scribe,
    describe,
    make_batch,
    make_predict,
    prepared,
    score_pairs,
    start_run,
)


def main(experiment: Experiment, description: str) -> None:
    data, prepare, settings, optim = experiment.data, experiment.prepare, experiment.run, experiment.optim
    folder = Path(settings.out) / settings.name

    # Devices: all of them share each batch; of several processes the first alone writes.
    if settings.distributed:
        devices.connect()
    mesh = devices.data_mesh(optim.batch)

    # Perceptual loss: its weights are asked for before time goes into preparation.
    weights = experiment.loss
    vgg = load_vgg(weights.vgg_weights) if weights.perceptual else None
    if vgg is None:
        print("perceptual loss: off (--loss.perceptual 0; the paper's weight is 10)")

    # Data: frames to aligned pairs on the camera's polar window, made once and kept.
    dataset = open_dataset(data)
    chosen = select(data.train, dataset)
    train = prepared(dataset, chosen, data, prepare)
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
    train_step = make_train_step(experiment, channels, vgg=vgg, mesh=mesh)
    state = start_from(create_state(experiment, channels, seed=settings.seed), optim.start, experiment)
    predict = make_predict(make_generate(experiment, channels), prepare)

    # Run: a new folder, or the one that the same command began.
    run = describe(experiment, dataset.spec, dataset[chosen[0]].camera)
    devices.by_first(lambda: start_run(folder, run))
    checkpoints = Checkpoints(folder, keep=settings.keep) if devices.is_first() else None
    if checkpoints and checkpoints.latest:
        state = checkpoints.restore("state", state)
        print(f"resuming {folder} at step {checkpoints.latest}")
    state = devices.everywhere(mesh, state)
    start = step = int(state.step)
    scribe = Scribe(folder, start, writes=devices.is_first())

    def save() -> None:
        if checkpoints:
            checkpoints.save(step, state=state, generator=ema_generator(state))

    def judge() -> None:
        """Validation scores and a picture of the averaged generator; meanwhile other processes wait in their step."""
        if not devices.is_first():
            return
        params, pair = devices.nearby(ema_generator(state)), validation[0]
        scores = score_pairs(predict, params, validation)
        scribe.write(step, {f"validation/{name}": score.value for name, score in scores.items()})
        picture = pair_picture(pair, np.asarray(predict(params, pair)), title=f"step {step}")
        save_picture(folder / "figures" / f"step_{step:06d}.png", picture)
        bar.write(f"step {step}: validation " + ", ".join(f"{name} {s.value:.4f}" for name, s in scores.items()))

    # Loop: batch k depends on (seed, k) alone, so a resumed run sees what an uninterrupted one would.
    begun = time.monotonic()
    shown = {"desc": settings.name, "unit": "step", "smoothing": 0.1, "mininterval": 1.0}
    bar = tqdm(total=optim.steps, initial=start, disable=not devices.is_first(), **shown)
    try:
        for k, pairs in enumerate(ahead(loader, start, optim.steps), start):
            batch = to_batch(devices.cut(mesh, pairs))
            updated, metrics = train_step(state, batch)
            if not bool(metrics["finite"]):
                scribe.stop_on_nan(k + 1, devices.to_host(batch), devices.to_host(metrics))
            state, step, last = updated, k + 1, k + 1 == optim.steps
            if step % settings.log_every == 0 or last:
                values = {name: float(value) for name, value in metrics.items() if name != "finite"}
                scribe.write(step, values)
                losses = {name[5:]: f"{value:.3f}" for name, value in values.items() if name.startswith("loss/")}
                bar.set_postfix(losses, refresh=False)
            bar.update()
            if step % settings.picture_every == 0 or last:
                judge()
            if step % settings.save_every == 0 or last:
                save()
    except KeyboardInterrupt:
        bar.close()
        save()
        sys.exit(f"stopped after step {step}, saved in {folder}; the same command resumes")
    bar.close()

    # Card: what the run is and what it scored.
    if devices.is_first():
        scores = score_pairs(predict, devices.nearby(ema_generator(state)), validation)
        write_card(folder, run, description, scores, seconds=time.monotonic() - begun)
        print(f"{folder}: {step} steps done. Scores beside baselines, and pictures: python eval.py {folder}")
    devices.wait("the end")


if __name__ == "__main__":
    enable_compilation_cache()
    with stop_on_error():
        main(*parse_experiment(configs, sys.argv[1:]))
