"""The one training loop; it reads top to bottom: devices, data and model, run, loop, card."""

from __future__ import annotations

import importlib
import logging
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jaxtyping import PyTree

from jaxsim import devices
from jaxsim.config import OptimConfig
from jaxsim.detect import LeftOut
from jaxsim.interrupts import ends_with_me, uninterrupted
from jaxsim.progress import Progress
from jaxsim.report.pictures import save_picture
from jaxsim.runs.kinds import AnyExperiment, kind_of
from jaxsim.runs.metrics_log import MetricsLog
from jaxsim.runs.run import Checkpoints, check_folder, load_run, start_run
from jaxsim.train.experiments import CONFIGS
from jaxsim.train.training import RunScores, Training, run_folder, write_training_card

_log = logging.getLogger(__name__)

TRAINER = (sys.executable, "-m", "jaxsim", "train")
"""The program that trains, of this very package."""


@devices.while_all_live()
def train(experiment: AnyExperiment, description: str = "") -> None:
    """Trains to the last step in the run's folder; the same experiment again resumes it.

    `description` is for the card. Raises ValueError where the experiment cannot be, or asks for no steps, or its folder
    holds another run or more steps, and TrainingDiverged where a loss is not finite; an interrupt saves, and is raised
    on with what is to be said.
    """
    settings = experiment.run
    folder = run_folder(settings)

    # Devices: all of them share each batch; of several processes the first alone writes.
    if settings.distributed:
        devices.connect()
    writes = devices.is_first()

    # Folder: whether the run can be kept there is known before time goes into the frames.
    devices.by_first(lambda: check_folder(folder, experiment))

    # Data and model: what the builder of this kind makes of the experiment.
    training = training_of(experiment)

    # Run: a new folder, or the one that the same command began.
    devices.by_first(lambda: _begin(folder, training))
    checkpoints, state = Checkpoints(folder, keep=settings.keep) if writes else None, training.state
    if checkpoints and checkpoints.latest:
        state = checkpoints.restore("state", state)
        _log.info(f"resuming {folder} at step {checkpoints.latest}")
    # The others restore nothing: what they begin with comes from the first, and so does where.
    start = step = devices.of_first(int(state.step))
    state = devices.everywhere(training.mesh(start), state)
    run = OpenRun(training, folder, checkpoints, MetricsLog(folder, start, writes=writes))

    # Loop: a resumed run sees the batches that an uninterrupted one would.
    begun = time.monotonic()
    scores = {}
    shown = {"desc": settings.name, "unit": "step", "smoothing": 0.1, "mininterval": 1.0}
    with run.log:
        bar = Progress(total=training.steps, initial=start, disable=not writes, **shown)
        step_log = StepLog(run.log, bar, every=settings.log_every)
        if start and training.due(start, training.judge_every) and writes and not run.log.validated(start):
            scores = run.judge(state, start)  # killed after it saved this step, before it judged it
        try:
            for k, batch in enumerate(training.batches(start, training.steps), start):
                # A step gives the memory of the old state to the new one: between them there is none to save.
                with uninterrupted():
                    updated, metrics = training.step(state, batch, k)
                    if not bool(metrics["finite"]):
                        run.log.stop_on_nan(k + 1, devices.to_host(batch), devices.to_host(metrics))
                    state, step = updated, k + 1
                    step_log.add(step, metrics, last=step == training.steps)
                    # Saved before it is judged: judging may take long, and may fail.
                    if training.due(step, training.save_every):
                        run.save(state, step)
                if training.due(step, training.judge_every):
                    scores = run.judge(state, step)
        except KeyboardInterrupt as stop:
            bar.close()
            with uninterrupted():  # half a checkpoint would stand in the way of the next one of its step
                run.save(state, step)
            lost = f"; {words}" if (words := step_log.left_out.words()) else ""
            raise type(stop)(f"stopped after step {step}, saved in {folder}; the same command resumes{lost}") from None
        bar.close()

    # Card: what the run is and what it scored.
    if writes:
        scores = run.last_scores(state, step, scores)
        write_training_card(folder, training, description, scores=scores, seconds=time.monotonic() - begun)
        _log.info(f"{folder}: {step} steps done. {training.hint}")
    devices.wait("the end")


@dataclass(frozen=True)
class OpenRun:
    """A training, and where it keeps what it comes to."""

    training: Training
    folder: Path
    checkpoints: Checkpoints | None
    """None in processes that do not write: of several the first alone does."""
    log: MetricsLog

    def save(self, state: PyTree, step: int) -> None:
        """Keeps the state of a step, and the network in it, unless they are kept."""
        if self.checkpoints and step not in self.checkpoints.steps:
            self.checkpoints.save(step, **{"state": state, self.training.network: self.training.used(state)})

    def judge(self, state: PyTree, step: int) -> RunScores:
        """Validation scores and a picture; meanwhile other processes wait in their step."""
        if not self.log.writes:
            return {}
        scores, picture = self.training.validate(devices.nearby(self.training.used(state)), step)
        # The scores last: a resumed run takes a step that has them for judged, and draws no picture of it.
        save_picture(self.folder / "figures" / f"step_{step:06d}.png", picture)
        self.log.write(step, {f"validation/{name}": score.value for name, score in scores.items()})
        _tell(scores, step)
        return scores

    def last_scores(self, state: PyTree, step: int, scores: RunScores) -> RunScores:
        """The card's scores; `scores` are those that the last step got, if this process made it."""
        used = devices.nearby(self.training.used(state))
        if self.training.finish:
            scores = self.training.finish(used)
            _tell(scores, step)
        elif not scores:  # all steps were done before
            scores = self.training.validate(used, step)[0]
        return scores


@dataclass
class StepLog:
    """What the steps of this process come to: lines of the log, the bar, and what found no room in them."""

    log: MetricsLog
    bar: Progress
    every: int
    """Steps a line of the log."""
    left_out: LeftOut = field(default_factory=LeftOut)
    warned: bool = False
    """Whether it was said that something is left out."""

    def add(self, step: int, metrics: Mapping[str, Any], *, last: bool) -> None:
        """One step's metrics; the last gets a line, too."""
        self.left_out.see(metrics)
        if step % self.every == 0 or last:
            values = {name: float(value) for name, value in metrics.items() if name != "finite"}
            self.log.write(step, values | self.left_out.take())
            losses = {name[5:]: f"{value:.3f}" for name, value in values.items() if name.startswith("loss/")}
            self.bar.set_postfix(losses, refresh=False)
            if (words := self.left_out.words()) and (last or not self.warned):
                _log.info(f"step {step}: {words}")
                self.warned = True
        self.bar.update()


def _tell(scores: RunScores, step: int) -> None:
    _log.info(f"step {step}: validation " + ", ".join(f"{name} {s.value:.4g}" for name, s in scores.items()))


def _begin(folder: Path, training: Training) -> None:
    """Starts the run's folder, or comes back to it. Raises ValueError as `start_run`, and where there is nothing to
    train: a run of no steps has no network, and one that has done more is not the run of so few."""
    done = Checkpoints(folder).latest or 0
    if training.steps < max(done, 1):
        raise ValueError(
            f"run: {folder} has done {done} steps, and the settings are for {training.steps} in all; ask for more "
            "(--optim.steps or --optim.epochs, of depth completion --penet.stages), or give another --run.name"
        )
    if done:
        warn_of_rate(folder, training, done)
    start_run(folder, training.run, training.frames)


def warn_of_rate(folder: Path, training: Training, done: int) -> None:
    """Warns where a run goes on by a rate that another number of steps gives, and has begun to lower it: it rises
    again, and the settings of the run do not say so."""
    optim = getattr(training.run.experiment, "optim", None)
    before = getattr(load_run(folder, kind_of(training.run).run).experiment, "optim", None)
    if not isinstance(optim, OptimConfig) or not isinstance(before, OptimConfig) or optim.steps == before.steps:
        return
    if done > before.decay_from * before.steps:
        _log.warning(
            f"run: {folder} has done {done} of {before.steps} steps, and lowered its rate from "
            f"{100 * before.decay_from:g} % of these on (optim.decay_from); with {optim.steps} in all it rises again, "
            "so that the network is not that of a run of so many from the start"
        )


def training_of(experiment: AnyExperiment) -> Training:
    """The training of an experiment, by the builder of its kind."""
    module, _, builder = kind_of(experiment).builder.partition(":")
    return getattr(importlib.import_module(module), builder)(experiment)


def train_apart(*arguments: str | Path, trainer: Sequence[str] = TRAINER) -> int:
    """Runs `jaxsim train ARGUMENTS`, or another `trainer`, in a process of its own, which gives its memory back and
    whose kill costs no other and which ends with this one; its exit status."""
    environment = {**os.environ, **ends_with_me()}
    if (CONFIGS.parent / "jaxsim").is_dir():  # a checkout, which need not be installed
        paths = (str(CONFIGS.parent), os.environ.get("PYTHONPATH", ""))
        environment["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    with subprocess.Popen([*trainer, *map(str, arguments)], env=environment) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:
            process.terminate()  # it saves its state before it ends; a kill would cost that
            process.wait()
            raise
