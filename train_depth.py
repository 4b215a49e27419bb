"""Trains a depth completion network, for `python train.py penet_...`; reads top to bottom like train.py.

Three stages, one after the other, in one run: runs/NAME holds config.json, checkpoints, metrics.jsonl, pictures, and at
the end weights.npz for `--prepare.depth penet --prepare.depth-weights`. The same command again resumes it.
"""

import sys
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from threading import Lock

import jax
import jax.numpy as jnp
import numpy as np
from pydantic import TypeAdapter
from tqdm import tqdm

from jaxsim import devices
from jaxsim.data import open_dataset, select
from jaxsim.data.kitti_depth import KittiDepth
from jaxsim.detect import ahead
from jaxsim.files import claim, lock, replacing
from jaxsim.frame import DepthFrame
from jaxsim.metrics import Score
from jaxsim.metrics.depth import benchmark_errors, depth_scores, interpolate_background
from jaxsim.prepare.depth.frames import depth_frame, where_backed
from jaxsim.prepare.depth.penet import NEAREST_M, save_penet
from jaxsim.prepare.depth.penet.training import (
    Batches,
    DepthExperiment,
    Part,
    begin_stage,
    branch_weight,
    check_sizes,
    create_state,
    predict,
    rate,
    train_step,
)
from jaxsim.report import depth_picture, save_picture
from jaxsim.runs.metrics_log import Scribe
from jaxsim.runs.run import FREE, Checkpoints

SETTINGS = TypeAdapter(DepthExperiment)
THREADS = 4
SHOWN = 4
"""Validation frames that are scored between the stages' ends; all are at the end."""


class Rendered(Sequence[DepthFrame]):
    """Frames of a renderer by position, each made once and kept in memory: a few hundred, 6 MB each."""

    def __init__(self, make: Callable[[int], DepthFrame], positions: Sequence[int]):
        self.make, self.positions, self.kept, self.lock = make, positions, {}, Lock()

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, i):
        with self.lock:
            if i not in self.kept:
                self.kept[i] = self.make(self.positions[i])
            return self.kept[i]


def frames_of(experiment: DepthExperiment) -> tuple[Sequence[DepthFrame], Sequence[DepthFrame]]:
    """Training and validation frames; KITTI's are read whenever they are asked for, as 92 750 do not fit into memory.

    Raises ValueError where the data set has no true depth, or a part of it is missing.
    """
    data, crop, judged = experiment.data, experiment.image_crop, experiment.depth_validation
    if experiment.depth_root is not None:
        train = KittiDepth(experiment.depth_root, data.root, part="train", crop=crop)
        return train, KittiDepth(judged or experiment.depth_root, data.root, part="val", crop=crop)
    if judged is not None:
        raise ValueError(
            f"penet: --depth-validation {judged} goes with --depth-root, the folder of KITTI's depth completion set "
            "that holds train/; other data are chosen by --data.validation"
        )
    dataset = open_dataset(data)
    make = lambda i: where_backed(depth_frame(dataset[i], crop))  # noqa: E731
    train, validation = (list(select(part, dataset)) for part in (data.train, data.validation))
    return Rendered(make, train), Rendered(make, validation)


def start(folder: Path, experiment: DepthExperiment) -> None:
    """Makes the run's folder, or checks that it holds this very run. Raises ValueError where it holds another."""
    lock(folder)
    claim(
        folder / "config.json",
        SETTINGS.dump_python(experiment, mode="json"),
        by="run",
        text=SETTINGS.dump_json(experiment, indent=2),
        read=lambda record: SETTINGS.dump_python(SETTINGS.validate_json(record), mode="json"),
        free=FREE,
        instead="another --run.name",
    )


def main(experiment: DepthExperiment, description: str) -> None:
    config, settings = experiment.penet, experiment.run
    folder = Path(settings.out) / settings.name
    check_sizes(experiment)

    # Devices: all of this process share each batch; stages differ in batch.
    if settings.distributed:
        raise ValueError("penet: depth completion is trained by one process, on all its devices: no --run.distributed")
    meshes = [devices.data_mesh(stage.batch) for stage in config.stages]

    # Data: the crop of each frame, its sparse depth and its truth.
    train, validation = frames_of(experiment)
    batches = Batches(train, config, settings.seed)
    last = len(batches)

    # Run: a new folder, or the one that the same command began.
    start(folder, experiment)
    state = create_state(config, settings.seed)
    checkpoints = Checkpoints(folder, keep=settings.keep)
    if checkpoints.latest is not None:
        state = checkpoints.restore("state", state)
        print(f"resuming {folder} at step {checkpoints.latest}")
    begun, start_step = time.monotonic(), int(state.step)
    scribe = Scribe(folder, start_step)

    def save() -> None:
        checkpoints.save(int(state.step), state=state, network=state.values)

    def judge(part: Part, shown: int) -> dict[str, Score]:
        """KITTI's scores of the first validation frames, and a picture of the very first."""
        step, values, errors, count = int(state.step), devices.nearby(state.values), [], min(shown, len(validation))
        for i in tqdm(range(count), desc="validation", unit="image", leave=False, disable=count <= SHOWN):
            frame = validation[i]
            batch = jax.tree.map(lambda x: np.asarray(x)[None], frame)
            guess = np.asarray(predict(values, batch, config=config, part=part))[0]
            guessed = np.isfinite(guess) & (guess > NEAREST_M)
            guess = np.where(guessed, guess, np.float32(0))
            if i == 0:
                picture = depth_picture(frame, [(f"step {step}", guess, guessed)])
                save_picture(folder / "figures" / f"step_{step:06d}.png", picture)
            if frame.known.any() and not (frame.known & ~interpolate_background(guess, guessed)[1]).any():
                errors.append(benchmark_errors(guess, guessed, frame.truth_m, frame.known))
        if len(errors) < count:
            bar.write(
                f"step {step}: {count - len(errors)} of {count} validation images not scored: no truth, or rows of it "
                f"where no depth exceeds {NEAREST_M} m"
            )
        return depth_scores(errors) if errors else {}

    # Loop: a resumed run sees the batches that an uninterrupted one would; threads read and crop ahead.
    bar = tqdm(total=last, initial=start_step, desc=settings.name, unit="step", smoothing=0.1, mininterval=1.0)
    try:
        for k, batch in enumerate(ahead(batches, start_step, last, threads=THREADS), start_step):
            number, epoch, place = batches.place(k)
            stage, mesh = config.stages[number], meshes[number]
            begins = epoch == place == 0
            if begins and k:
                state = begin_stage(state, config)
            if begins or k == start_step:
                state = devices.everywhere(mesh, devices.nearby(state))
            lr, weight = (jnp.float32(x) for x in (rate(config, stage, epoch), branch_weight(epoch)))
            state, metrics = train_step(
                state, devices.cut(mesh, batch), lr, weight, config=config, part=stage.part, norms=stage.norms
            )
            step = k + 1
            if not bool(metrics["finite"]):
                arrays = {name: np.asarray(getattr(batch, name)) for name in ("rgb", "sparse_m", "truth_m")}
                scribe.stop_on_nan(step, arrays, {n: float(v) for n, v in metrics.items() if n != "finite"})
            if step % settings.log_every == 0 or step == last:
                scribe.write(step, {n: float(v) for n, v in metrics.items() if n != "finite"})
                bar.set_postfix(stage=stage.part, rmse=f"{float(metrics['rmse_m']):.2f} m", refresh=False)
            bar.update()
            if step % settings.save_every == 0 or step in batches.ends:
                save()
            if step % settings.picture_every == 0 or step in batches.ends:
                scores = judge(stage.part, SHOWN)
                scribe.write(step, {f"validation/{name}": score.value for name, score in scores.items()})
                bar.write(f"step {step} ({stage.part}): " + ", ".join(f"{n} {s.value:.4g}" for n, s in scores.items()))
    except KeyboardInterrupt:
        bar.close()
        save()
        sys.exit(f"stopped after step {int(state.step)}, saved in {folder}; the same command resumes")
    bar.close()

    # Weights for preparation, and a card that says what they are and scored.
    save_penet(folder / "weights.npz", devices.to_host(state.values))
    scores = judge(config.stages[-1].part, len(validation))
    lines = "\n".join(
        f"- {name}: {score.value:.4g} {score.unit} ({score.count} of {len(validation)} images)"
        for name, score in scores.items()
    )
    lines = lines or "- not one validation image could be scored"
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
