"""The training of an intensity network: pairs of painted camera and measured LiDAR, pix2pixHD's two networks."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import PyTree

from jaxsim import devices
from jaxsim.config import Experiment, GeneratorConfig, OptimConfig
from jaxsim.data import Dataset, open_dataset, select
from jaxsim.data.batches import Changing, batches
from jaxsim.data.records import PreparedPairs
from jaxsim.data.seen import warn_of_seen_pairs
from jaxsim.data.turned import Turned
from jaxsim.evaluate.intensity import Predict, score_pairs
from jaxsim.files import as_argument
from jaxsim.frame import INTENSITY_STEP, Pair
from jaxsim.pairs.prepared import prepared
from jaxsim.pix2pix import create_state, load_vgg, make_generate, make_train_step, start_from
from jaxsim.pix2pix.unet import cells_alone
from jaxsim.prepare import input_channels
from jaxsim.report.pictures import pair_picture
from jaxsim.report.results import score_table
from jaxsim.runs.frames import RunFrames, check_frames
from jaxsim.runs.run import Checkpoints, describe_run
from jaxsim.simulate.grain import save_grain
from jaxsim.simulate.grain_fit import learn_grain
from jaxsim.simulate.predict import Prediction, make_predict
from jaxsim.train.intensity_batch import make_batch
from jaxsim.train.training import Picture, RunScores, Training, ahead, run_folder

_log = logging.getLogger(__name__)

HELD = 500
"""Pairs that are held in memory, of about a megabyte each; more are read from disk, each time one is asked for."""

NO_SIDES = {"prepared": "a prepared set keeps no scans", "polar": "views of polar frames look all round already"}
"""Kinds of data whose scans have no sides beside those that are frames of their own, and why. A side of one view is the
next one, which may be what judges."""


def intensity_training(experiment: Experiment) -> Training:
    """Raises ValueError and FileNotFoundError where data or weights are missing, before any time goes into them."""
    data = experiment.data
    prepare = experiment.prepare
    settings = experiment.run
    optim = experiment.optim
    mesh = devices.data_mesh(optim.batch, members=experiment.generator.members)
    _check_settings(experiment)

    # Perceptual loss: its weights are asked for before time goes into preparation.
    weights = experiment.loss
    vgg = load_vgg(weights.vgg_weights) if weights.perceptual else None
    if vgg is None and weights.gan:  # what is no GAN has none in the paper either
        _log.info("perceptual loss: off (--loss.perceptual 0; the paper's weight is 10)")

    # Data: frames to aligned pairs on the camera's polar window, made once and kept (or by `jaxsim prepare`).
    dataset = open_dataset(data)
    chosen, judging = select(data.train, dataset), select(data.validation, dataset)
    folder, frames = run_folder(settings), RunFrames.at(dataset, chosen, validation=judging)
    check_frames(folder, frames)
    train = prepared(dataset, chosen, data, prepare=prepare)
    validation = prepared(dataset, judging, data, prepare=prepare)
    warn_of_seen_pairs(train, validation)
    if optim.epochs:
        optim = replace(optim, steps=optim.epochs * len(train) // optim.batch)
        experiment = replace(experiment, optim=optim)
    sides = _other_sides(dataset, chosen, experiment) if optim.sides else train[:0]
    until = round(optim.sides * optim.steps)
    loader = _loader(train, sides, experiment, until=until)
    to_batch = make_batch(
        replace(prepare, network_size=_cut_size(experiment)),
        drop_weight=weights.drop_weight,
        unseen_weight=weights.unseen_weight,
        occluded_weight=weights.occluded_weight,
    )

    # Model: both networks, their optimisers and the averaged generator, one pytree.
    channels = input_channels(prepare)
    train_step = make_train_step(experiment, channels, vgg=vgg, mesh=mesh)
    judge = Judge(make_predict(make_generate(experiment, channels), prepare), validation, experiment.generator)
    run = describe_run(experiment, dataset.spec, train.record(0).view)
    return Training(
        run=run,
        frames=frames,
        steps=optim.steps,
        save_every=settings.save_every,
        judge_every=settings.picture_every,
        state=start_from(
            create_state(experiment, channels, seed=settings.seed), start_files(folder, optim), experiment
        ),
        mesh=lambda k: mesh,
        batches=lambda a, b: (to_batch(devices.cut(mesh, pairs)) for pairs in ahead(loader, a, b)),
        step=lambda state, batch, k: train_step(state, batch),
        network="generator",
        used=lambda state: state.ema,
        validate=judge.validate,
        facts=(
            f"data: {data.kind}, frames {data.train} (validation {data.validation})",
            *([f"{len(sides)} other sides of their scans, until step {until}"] if sides else []),
            f"inputs: {', '.join(prepare.inputs)}",
            f"batch: {optim.batch}",
            f"sensor: {run.spec.name}, {run.spec.rows} lines",
        ),
        scored=lambda scores: score_table({"validation": scores}),
        use=f'```python\nimport jaxsim\nsensor = jaxsim.load("{folder}")\n```',
        finish=partial(judge.finish, folder) if experiment.generator.form == "unet" else None,
        hint=f"Scores beside baselines, and pictures: jaxsim eval {as_argument(folder)}",
    )


def _check_settings(experiment: Experiment) -> None:
    """Raises ValueError where so much cannot be cut out of a pair, and where the data have no other sides."""
    optim = experiment.optim
    whole_size = experiment.prepare.network_size
    for name, part, whole in zip(("rows", "columns"), (optim.rows, optim.columns), whole_size, strict=True):
        if part > whole:
            raise ValueError(
                f"train: --optim.{name} {part} cannot be cut out of {whole} {name} (--prepare.network-size); give at "
                "most as many, or 0 for all"
            )
    kind = experiment.data.kind
    if optim.sides and kind in NO_SIDES:
        raise ValueError(
            f"train: {NO_SIDES[kind]}, so that there are no other sides to learn from; pass --optim.sides 0"
        )


def _cut_size(experiment: Experiment) -> tuple[int, int]:
    """Rows and columns that a batch has of each pair."""
    rows, columns = experiment.prepare.network_size
    return experiment.optim.rows or rows, experiment.optim.columns or columns


def _other_sides(dataset: Dataset, chosen: list[int], experiment: Experiment) -> PreparedPairs:
    """Pairs of the sides of the chosen frames' scans that no camera sees."""
    turned = Turned(dataset)
    # No input is asked for that a side does not have: neither image nor labels.
    prepare = replace(experiment.prepare, inputs=())
    return prepared(turned, turned.sides(chosen), experiment.data, prepare=prepare)


def _loader(train: PreparedPairs, sides: PreparedPairs, experiment: Experiment, *, until: int) -> Any:
    """Batches by number: of the training pairs and, before number `until`, of other sides too."""
    optim = experiment.optim
    size, cut = experiment.prepare.network_size, _cut_size(experiment)
    # Scaled on the host where frames are magnified or cut, or where drives of other calibrations see other windows.
    alike = train.windows == {size} if cut != size else len(train.windows) == 1
    load = partial(
        batches,
        size=optim.batch,
        seed=experiment.run.seed,
        flip=optim.flip,
        jitter=optim.jitter,
        scale_limit=optim.scale_limit,
        raster=size if optim.scale_limit or not alike else None,
        cut=cut if cut != size else None,
        part=jax.process_index(),
        parts=jax.process_count(),
    )
    learned = train + sides
    pairs = list(learned) if len(learned) <= HELD else learned
    return load(pairs) if until == optim.steps else Changing(load(pairs), load(pairs[: len(train)]), at=until)


@dataclass(frozen=True)
class Judge:
    """Scores the averaged generator by pairs that it does not learn from."""

    predict: Predict
    pairs: PreparedPairs
    generator: GeneratorConfig

    def validate(self, params: PyTree, step: int) -> tuple[RunScores, Picture]:
        """Scores, and a picture of the first pair."""
        first = self.pairs[0]
        says = self.predict(params, first)
        if self.generator.form == "unet" and self.generator.downsamples:
            _warn_of_silence(says, self.predict(cells_alone(params), first), first)
        picture = pair_picture(first, np.asarray(says.reported), title=f"step {step}")
        return score_pairs(self.predict, params, self.pairs), picture

    def finish(self, folder: Path, params: PyTree) -> RunScores:
        """Last scores; and how the cells of draws scatter together, where there is a distribution to draw from."""
        try:
            save_grain(folder, learn_grain(self.predict, params, self.pairs, scenes=self.pairs.scenes))
        except ValueError as error:  # of too few frames; draws say so when they are asked for
            _log.info(f"no grain was learned: {error}")
        return score_pairs(self.predict, params, self.pairs)


def start_files(folder: Path, optim: OptimConfig) -> tuple[Path, ...]:
    """The converted files that the run in a folder begins from; none once it has a checkpoint, which holds what became
    of them, so that they may be gone by then."""
    return () if optim.start and Checkpoints(folder).latest is not None else optim.start


def _warn_of_silence(says: Prediction, alone: Prediction, pair: Pair) -> None:
    """What a U-Net gathers of the surroundings can come to lie below 0 in every cell: it is heard no more and learns no
    more, and nothing else tells. `alone` is what it says without them; less than a tenth of the sensor's step shows in
    hardly any reading."""
    change = np.abs(np.asarray(says.intensity) - np.asarray(alone.intensity))[np.asarray(pair.painted.valid)].mean()
    if change < INTENSITY_STEP / 10:
        _log.warning(
            f"each cell answers from its own inputs alone (without its surroundings intensities change by {change:.4f} "
            "in the mean): what the network gathered of them went silent in training. Train with a lower --optim.lr, a "
            "longer --optim.warm-up or another --run.seed"
        )
