"""Trains a depth completion network, for `python train.py penet_...`; reads top to bottom like train.py.

Three stages, one after the other, in one run: runs/NAME holds config.json, checkpoints, metrics.jsonl, pictures, and at
the end weights.npz for `--prepare.depth penet --prepare.depth-weights`. The same command again resumes it.
"""

import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from pydantic import TypeAdapter
from tqdm import tqdm

from jaxsim.atomic import replacing
from jaxsim.data import open_dataset, select
from jaxsim.data.kitti_depth import KittiDepth
from jaxsim.data.pair_settings import differences
from jaxsim.frame import DepthFrame
from jaxsim.metrics.depth import depth_errors, depth_scores
from jaxsim.prepare.depth.frames import depth_frame, where_backed
from jaxsim.prepare.depth.penet import NEAREST_M, save_penet
from jaxsim.prepare.depth.penet.training import (
    DepthExperiment,
    Part,
    batch_of,
    begin_stage,
    branch_weight,
    create_state,
    predict,
    rate,
    steps_of,
    train_step,
)
from jaxsim.report import depth_picture, save_picture
from jaxsim.simulate import Checkpoints, Scribe
from jaxsim.simulate.lock import hold
from jaxsim.simulate.run import FREE

SETTINGS = TypeAdapter(DepthExperiment)
SHOWN = 4
"""Validation frames that are scored between the stages' ends; all are at the end."""


class Frames(Sequence[DepthFrame]):
    """Training frames by position, each made once and kept in memory."""

    def __init__(self, make, positions: list[int]):
        self.make, self.positions, self.kept = make, positions, {}

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, i):
        if i not in self.kept:
            self.kept[i] = self.make(self.positions[i])
        return self.kept[i]


def frames_of(experiment: DepthExperiment) -> tuple[Frames, Frames]:
    """Training and validation frames. Raises ValueError where the data set has no true depth."""
    data, crop = experiment.data, experiment.image_crop
    if experiment.depth_root is not None:
        parts = [KittiDepth(experiment.depth_root, data.root, part=part, crop=crop) for part in ("train", "val")]
        return tuple(Frames(part.__getitem__, list(range(len(part)))) for part in parts)  # type: ignore[return-value]
    dataset = open_dataset(data)
    make = lambda i: where_backed(depth_frame(dataset[i], crop))  # noqa: E731
    return Frames(make, list(select(data.train, dataset))), Frames(make, list(select(data.validation, dataset)))


def start(folder: Path, experiment: DepthExperiment) -> None:
    """Makes the run's folder, or checks that it holds this very run. Raises ValueError where it holds another."""
    hold(folder)
    path = folder / "config.json"
    if path.is_file():
        was, now = (
            SETTINGS.dump_python(e, mode="json") for e in (SETTINGS.validate_json(path.read_bytes()), experiment)
        )
        if other := [line for line in differences(was, now) if line.split()[0][2:] not in FREE]:
            raise ValueError(
                f"run: {folder} holds a run with other settings ({'; '.join(other)}); give this one another --run.name"
            )
    with replacing(path) as temporary:
        temporary.write_bytes(SETTINGS.dump_json(experiment, indent=2))


def main(experiment: DepthExperiment, description: str) -> None:
    config, settings = experiment.penet, experiment.run
    folder = Path(settings.out) / settings.name

    # Data: the crop of each frame, its sparse depth and its truth.
    train, validation = frames_of(experiment)
    lengths = [stage.epochs * steps_of(stage, len(train)) for stage in config.stages]
    ends = np.cumsum(lengths)

    # Run: a new folder, or the one that the same command began.
    start(folder, experiment)
    state = create_state(config, settings.seed)
    checkpoints = Checkpoints(folder, keep=settings.keep)
    if checkpoints.latest is not None:
        state = checkpoints.restore("state", state)
        print(f"resuming {folder} at step {checkpoints.latest}")
    scribe = Scribe(folder, int(state.step))

    def save() -> None:
        checkpoints.save(int(state.step), state=state, network=state.values)

    def judge(part: Part, shown: int) -> dict:
        """Scores of the first validation frames, and a picture of the very first."""
        errors = []
        for i in range(min(shown, len(validation))):
            frame = jax.tree.map(lambda x: np.asarray(x)[None], validation[i])
            guess = np.asarray(predict(state.values, frame, config=config, part=part))[0]
            errors.append(depth_errors(guess, guess > NEAREST_M, frame.truth_m[0], frame.known[0]))
            if i == 0:
                picture = depth_picture(validation[i], [(f"step {int(state.step)}", guess, guess > NEAREST_M)])
                save_picture(folder / "figures" / f"step_{int(state.step):06d}.png", picture)
        return depth_scores(errors)

    # Loop: batch k depends on (seed, k) alone, so a resumed run sees what an uninterrupted one would.
    begun, last = time.monotonic(), int(ends[-1])
    bar = tqdm(total=last, initial=int(state.step), desc=settings.name, unit="step", smoothing=0.1, mininterval=1.0)
    try:
        for k in range(int(state.step), last):
            number = int(np.searchsorted(ends, k, side="right"))
            stage = config.stages[number]
            within = k - int(ends[number] - lengths[number])
            epoch, place = divmod(within, steps_of(stage, len(train)))
            if within == 0 and k:
                state = begin_stage(state, config)
            batch = batch_of(train, stage, config, seed=settings.seed, number=number, epoch=epoch, place=place)
            lr, weight = (jnp.float32(x) for x in (rate(config, stage, epoch), branch_weight(epoch)))
            state, metrics = train_step(state, batch, lr, weight, config=config, part=stage.part, norms=stage.norms)
            step = k + 1
            if not bool(metrics["finite"]):
                arrays = {name: np.asarray(getattr(batch, name)) for name in ("rgb", "sparse_m", "truth_m")}
                scribe.stop_on_nan(step, arrays, {n: float(v) for n, v in metrics.items() if n != "finite"})
            if step % settings.log_every == 0 or step == last:
                scribe.write(step, {n: float(v) for n, v in metrics.items() if n != "finite"})
                bar.set_postfix(stage=stage.part, rmse=f"{float(metrics['rmse_m']):.2f} m", refresh=False)
            bar.update()
            if step % settings.picture_every == 0 or step in ends:
                scores = judge(stage.part, SHOWN)
                scribe.write(step, {f"validation/{name}": score.value for name, score in scores.items()})
                bar.write(f"step {step} ({stage.part}): " + ", ".join(f"{n} {s.value:.4g}" for n, s in scores.items()))
            if step % settings.save_every == 0 or step in ends:
                save()
    except KeyboardInterrupt:
        bar.close()
        save()
        sys.exit(f"stopped after step {int(state.step)}, saved in {folder}; the same command resumes")
    bar.close()

    # Weights for preparation, and a card that says what they are and scored.
    save_penet(folder / "weights.npz", jax.tree.map(np.asarray, state.values))
    scores = judge(config.stages[-1].part, len(validation))
    lines = "\n".join(
        f"- {name}: {score.value:.4g} {score.unit} ({score.count} images)" for name, score in scores.items()
    )
    with replacing(folder / "card.md") as path:
        path.write_text(
            f"# {folder.name}\n\n{description.splitlines()[0] if description else 'A depth completion network.'}\n\n"
            f"{lines}\n- {last} steps, {(time.monotonic() - begun) / 60:.1f} minutes since the last start\n"
            f"- jaxsim {version('jaxsim-lidar')}; all settings are in config.json\n\n"
            f"`--prepare.depth penet --prepare.depth-weights {folder}/weights.npz`\n"
        )
    print(
        f"{folder}: {last} steps done.\n{lines}\n"
        f"use: --prepare.depth penet --prepare.depth-weights {folder}/weights.npz"
    )
