"""The loop, on a training that only adds: what it saves, judges and writes, and that a stopped run ends the same."""

import errno
import json
import os
import signal
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from jaxsim.config import DataConfig, DepthExperiment, DetectorExperiment, Experiment, LossConfig, RunConfig
from jaxsim.frame import Camera, CameraFrame
from jaxsim.geometry import preset
from jaxsim.interrupts import terminable
from jaxsim.metrics import Score
from jaxsim.runs.frames import RunFrames, read_frames, write_frames
from jaxsim.runs.kinds import DetectorRun, Run
from jaxsim.runs.metrics_log import Tracker, TrainingDiverged
from jaxsim.runs.run import Checkpoints, describe_run, start_run
from jaxsim.train import train
from jaxsim.train.loop import training_of, warn_of_rate
from jaxsim.train.training import Training


class Sum(NamedTuple):
    step: np.ndarray
    total: np.ndarray


class Adding:
    """Seven steps, saved and judged after every third; `at` names what happens at which step."""

    def __init__(self, folder: Path, **at: int):
        self.folder, self.at, self.judged = folder, at, []
        self.experiment = DetectorExperiment(run=RunConfig(name=folder.name, out=folder.parent, log_every=2))

    def step(self, state, batch, k):
        if self.at.get("interrupt") == k:
            raise KeyboardInterrupt
        total = state.total + batch["number"]
        finite = self.at.get("diverge") != k
        return Sum(state.step + 1, total), {"loss/sum": total if finite else np.float32(np.nan), "finite": finite}

    def validate(self, total, step):
        if self.at.get("fail") == step:
            raise RuntimeError("no frame to judge by")
        self.judged.append(step)
        return {"sum": Score(float(total), "1", 1)}, np.zeros((4, 4, 3), np.uint8)

    def training(self, **changes) -> Training:
        made = Training(
            run=DetectorRun(self.experiment, 7, 1),
            frames=RunFrames(("a-0", "a-1"), ("b-0",)),
            steps=7,
            save_every=3,
            judge_every=3,
            state=Sum(np.int32(0), np.float32(0)),
            mesh=lambda k: None,
            batches=lambda a, b: ({"number": np.float32(k)} for k in range(a, b)),
            step=self.step,
            network="total",
            used=lambda state: state.total,
            validate=self.validate,
            facts=("numbers: 0 to 6",),
            scored=lambda scores: f"sum {scores['sum'].value:g}",
            use="Add more.",
            hint="Look at the sum.",
        )
        return replace(made, **changes)

    def run(self, monkeypatch, **changes) -> list[dict]:
        monkeypatch.setattr("jaxsim.train.loop.training_of", lambda experiment: self.training(**changes))
        train(self.experiment, "Adds numbers.\nSlowly.")
        return [json.loads(line) for line in (self.folder / "metrics.jsonl").read_text().splitlines()]


def test_a_run_is_saved_judged_logged_and_described(tmp_path, monkeypatch, capsys):
    adding = Adding(tmp_path / "run")
    lines = adding.run(monkeypatch)
    assert [(line["step"], line["loss/sum"]) for line in lines if "loss/sum" in line] == [
        (2, 1),
        (4, 6),
        (6, 15),
        (7, 21),
    ]
    assert [line["step"] for line in lines if "validation/sum" in line] == adding.judged == [3, 6, 7]
    assert Checkpoints(adding.folder).steps == [6, 7]
    assert read_frames(adding.folder) == adding.training().frames
    assert sorted(path.name for path in (adding.folder / "figures").iterdir())[-1] == "step_000007.png"
    card = (adding.folder / "card.md").read_text()
    assert card.startswith(
        "---\nlibrary_name: jaxsim\nlicense: apache-2.0\ntags:\n- lidar\n- jax\n- synthetic\n---\n\n"
    )
    assert card.split("---\n\n", 1)[1].startswith("# run\n\nAdds numbers.\n\n- numbers: 0 to 6\n- 7 steps; ")
    assert card.endswith("\n\nsum 21\n\nAdd more.\n")
    said = capsys.readouterr().out
    assert "step 7: validation sum 21" in said
    assert f"{adding.folder}: 7 steps done. Look at the sum." in said


def test_0_steps_between_checkpoints_and_scores_is_the_end_alone(tmp_path, monkeypatch):
    adding = Adding(tmp_path / "run")
    adding.run(monkeypatch, save_every=0, judge_every=0)
    assert adding.judged == [7]
    assert Checkpoints(adding.folder).steps == [7]


def test_milestones_are_saved_and_judged_and_the_end_may_score_anew(tmp_path, monkeypatch):
    adding, ends = Adding(tmp_path / "run"), []

    def finish(total):
        ends.append(float(total))
        return {"sum": Score(42.0, "1", 1)}

    lines = adding.run(monkeypatch, milestones=frozenset({5}), finish=finish)
    assert adding.judged == [3, 5, 6, 7]
    assert ends == [21.0]
    assert "sum 42" in (adding.folder / "card.md").read_text()
    assert all(line.get("validation/sum") != 42 for line in lines)


@pytest.mark.parametrize("at", [{"interrupt": 4}, {"interrupt": 3}, {"fail": 3}, {"fail": 7}])
def test_a_stopped_run_ends_with_the_lines_of_an_unstopped_one(tmp_path, monkeypatch, at):
    """Also where it stopped between saving a step and judging it."""
    whole = Adding(tmp_path / "whole").run(monkeypatch)
    with pytest.raises((KeyboardInterrupt, RuntimeError)):
        Adding(tmp_path / "stopped", **at).run(monkeypatch)
    assert Adding(tmp_path / "stopped").run(monkeypatch) == whole
    assert Adding(tmp_path / "stopped").run(monkeypatch) == whole  # all is done: nothing is written twice


@pytest.mark.parametrize("at", [{}, {"interrupt": 4}, {"diverge": 2}, {"fail": 3}])
def test_trackers_are_told_of_the_end(tmp_path, monkeypatch, at):
    ends = []
    tracker = Tracker(lambda step, values: None, lambda failed: ends.append(failed))
    monkeypatch.setattr("jaxsim.runs.metrics_log.trackers", lambda folder, start: {"own": tracker})
    with pytest.raises((KeyboardInterrupt, RuntimeError, TrainingDiverged)) if at else nullcontext():
        Adding(tmp_path / "run", **at).run(monkeypatch)
    assert ends == [bool(at)]


def test_a_run_of_no_steps_or_of_fewer_than_are_done_is_refused(tmp_path, monkeypatch):
    """Nothing could be loaded of the one; the card and the settings of the other told of fewer steps than it had."""
    with pytest.raises(ValueError, match=r"has done 0 steps, and the settings are for 0 in all"):
        Adding(tmp_path / "none").run(monkeypatch, steps=0)
    assert not (tmp_path / "none").exists()
    adding = Adding(tmp_path / "run")
    whole = adding.run(monkeypatch)
    before = {path.name: path.read_bytes() for path in adding.folder.glob("*.*")}
    with pytest.raises(ValueError, match=r"has done 7 steps, and the settings are for 6 in all; ask for more"):
        adding.run(monkeypatch, steps=6)
    assert {path.name: path.read_bytes() for path in adding.folder.glob("*.*")} == before
    assert adding.run(monkeypatch) == whole


@pytest.mark.parametrize(("done", "decay_from", "told"), [(2, 0.5, False), (3, 0.5, True), (3, 1.0, False)])
def test_a_run_that_lowers_its_rate_already_is_told_what_more_steps_do(tmp_path, caplog, done, decay_from, told):
    """Its rate rises again, and no settings say so."""

    def of(steps: int) -> Run:
        experiment = Experiment()
        optim = replace(experiment.optim, steps=steps, decay_from=decay_from)
        camera = Camera(np.eye(3, dtype=np.float32), np.eye(4, dtype=np.float32))
        view = CameraFrame(np.zeros((375, 1242, 3), np.uint8), camera)
        return describe_run(replace(experiment, optim=optim), preset("hdl64e"), view)

    start_run(tmp_path, of(4))
    warn_of_rate(tmp_path, Adding(tmp_path).training(run=of(8), steps=8), done)
    assert ("has done 3 of 4 steps, and lowered its rate from 50 %" in caplog.text) == told
    caplog.clear()
    # The same number of steps goes on as it would have.
    warn_of_rate(tmp_path, Adding(tmp_path).training(run=of(4), steps=4), done)
    assert not caplog.text


def test_what_is_not_finite_ends_the_run_before_it_is_kept(tmp_path, monkeypatch):
    with pytest.raises(TrainingDiverged, match=r"loss/sum not finite at step 5.*lower --optim\.lr"):
        Adding(tmp_path / "run", diverge=4).run(monkeypatch)
    assert np.load(tmp_path / "run" / "diverged_000005.npz")["number"] == 4
    assert Checkpoints(tmp_path / "run").latest == 3


def test_a_folder_of_another_run_is_refused_before_anything_is_made(tmp_path, monkeypatch):
    adding = Adding(tmp_path / "run")
    adding.run(monkeypatch)

    def made(experiment):
        raise AssertionError("frames were made")

    monkeypatch.setattr("jaxsim.train.loop.training_of", made)
    other = replace(adding.experiment, data=replace(adding.experiment.data, root=tmp_path / "moved"))
    with pytest.raises(ValueError, match=r"data\.root was None, now .*moved.*another --run\.name"):
        train(other)
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError) as stop:
        train(replace(other, run=replace(other.run, out=tmp_path / "file")))
    assert stop.value.filename == str(tmp_path / "file/run")
    for name in ("../../x", "..", "a/b"):
        with pytest.raises(ValueError, match=r"must be the name of a folder below --run\.out"):
            train(replace(other, run=replace(other.run, name=name)))


def test_a_diverged_run_is_told_what_its_folder_takes(tmp_path, monkeypatch):
    """A lower rate, as is advised, needs a folder of its own."""
    diverging = Adding(tmp_path / "run", diverge=4)
    with pytest.raises(TrainingDiverged, match=r"lower --optim\.lr .*and give another --run\.name"):
        diverging.run(monkeypatch)
    slower = Adding(tmp_path / "run")
    slower.experiment = replace(slower.experiment, optim=replace(slower.experiment.optim, lr=1e-5))
    with pytest.raises(ValueError, match=r"optim\.lr was .*another --run\.name"):
        slower.run(monkeypatch)
    renamed = Adding(tmp_path / "slower")
    renamed.experiment = replace(renamed.experiment, optim=slower.experiment.optim)
    assert renamed.run(monkeypatch)


def test_an_interrupt_right_after_a_resume_saves_nothing_twice(tmp_path, monkeypatch):
    whole = Adding(tmp_path / "whole").run(monkeypatch)
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt, match=r"stopped after step 4, saved in .*the same command resumes"):
            Adding(tmp_path / "stopped", interrupt=4).run(monkeypatch)
        assert Checkpoints(tmp_path / "stopped").steps == [3, 4]
    assert Adding(tmp_path / "stopped").run(monkeypatch) == whole


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_step_waits_for_its_end(tmp_path, monkeypatch, number):
    """The old state's memory is given to the new one's: between them there is nothing that could be saved."""

    class Stopped(Adding):
        def step(self, state, batch, k):
            if k == 4:
                os.kill(os.getpid(), number)
                state.total.fill(np.nan)
                return Sum(np.int32(5), np.float32(10)), {"loss/sum": np.float32(10), "finite": True}
            state, metrics = super().step(state, batch, k)
            return Sum(state.step, np.array(state.total)), metrics

    whole = Adding(tmp_path / "whole").run(monkeypatch)
    with terminable(), pytest.raises(KeyboardInterrupt, match="stopped after step 5"):
        Stopped(tmp_path / "run").run(monkeypatch)
    assert Checkpoints(tmp_path / "run").steps == [3, 5]
    assert Adding(tmp_path / "run").run(monkeypatch) == whole


def test_a_step_whose_picture_found_no_room_is_judged_again(tmp_path, monkeypatch):
    whole = Adding(tmp_path / "whole").run(monkeypatch)

    def full(path, picture):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    with monkeypatch.context() as no_room:
        no_room.setattr("jaxsim.train.loop.save_picture", full)
        with pytest.raises(OSError, match="No space left"):
            Adding(tmp_path / "run").run(monkeypatch)
    assert Adding(tmp_path / "run").run(monkeypatch) == whole
    pictures = [sorted(path.name for path in (tmp_path / name / "figures").iterdir()) for name in ("whole", "run")]
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize("kind", [Experiment, DetectorExperiment, DepthExperiment])
def test_a_run_that_learned_from_other_frames_is_refused_before_time_goes_into_these(tmp_path, kind):
    """As where a drive that sorts first joined the data set, so that the same positions are other frames."""
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.json").write_text("{}")
    write_frames(tmp_path / "run", RunFrames(("synthetic-0-000000", "gone"), ("synthetic-0-000007",)))
    data = DataConfig(train="0-1", validation="7", cache=tmp_path / "cache")
    experiment = replace(kind(), data=data, run=RunConfig(name="run", out=tmp_path))
    if isinstance(experiment, Experiment):
        experiment = replace(experiment, loss=LossConfig(perceptual=0.0))
    told = (
        r"learned from other frames .*: 1 of its 2 .*\(the first: gone\), 1 are new \(the first: synthetic-0-000001\)"
    )
    with pytest.raises(ValueError, match=told):
        training_of(experiment)
