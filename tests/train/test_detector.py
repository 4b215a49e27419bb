"""The detector learns: eight scenes by heart, the whole job as a user runs it, on one device or two."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim.detect.steps import _create
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints, load_run, start_run
from tests.detect.tiny import EXPERIMENT, scene
from tests.programs import ROOT, running, said, wait_until

FLAGS = [
    "--data.train=0,8,20,24", "--data.validation=0,8", "--optim.epochs=2", "--run.log-every=3",
    "--voxels.max-voxels-train=2000", "--voxels.max-voxels=3000", "--augment.sampled=2",
    "--detector.train-proposals.after=16", "--detector.roi.rois=8", "--detector.roi.grid=3",
    "--detector.backbone.widths", "4", "4", "4", "4", "--detector.backbone.out=4",
]  # fmt: skip
TRAIN = str(ROOT / "train.py"), "voxel_rcnn_small", *FLAGS
QUICK = {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
"""Four steps run here, and LLVM would work on them far longer than they run."""


def run(work: Path, *command: str) -> str:
    return said(work, *command, **QUICK)


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """A folder with runs/voxel_rcnn_small, and what the command said that trained it: four steps, two epochs."""
    work = tmp_path_factory.mktemp("work")
    return work, run(work, *TRAIN)


@pytest.mark.slow
def test_a_detector_is_trained_resumed_scored_and_used(work):
    work, said = work
    folder = work / "runs" / "voxel_rcnn_small"
    assert {"config.json", "checkpoints", "metrics.jsonl", "figures", "card.md"} <= {p.name for p in folder.iterdir()}
    lines = metrics(folder)
    assert [line["step"] for line in lines if "loss/total" in line] == [3, 4]
    assert [line["step"] for line in lines if "validation/AP_3d_moderate" in line] == [2, 4]
    assert all(line["dropped/voxels"] > 0 for line in lines if "loss/total" in line)
    assert "no room for all of a scene in 3 of 3 steps" in said
    assert "raise --voxels.growth, --voxels.max-voxels-train" in said
    assert sorted(p.name for p in (folder / "checkpoints").iterdir() if p.name.isdigit()) == ["2", "4"]

    assert "resuming" in run(work, *TRAIN)
    said = run(work, str(ROOT / "eval.py"), str(folder))
    assert "mean (standard deviation) of the last 2 " in said
    assert (folder / "evaluation" / "detection.json").is_file()
    clouds = work / "clouds"
    clouds.mkdir()
    scene(0).points.tofile(clouds / "one.bin")
    run(work, "-m", "jaxsim", "detect", str(folder), "--clouds", str(clouds), "--out", str(work / "out"))
    assert (work / "out" / "results" / "one.txt").is_file()


def metrics(folder):
    return [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]


@pytest.mark.slow
def test_a_detector_killed_in_its_first_epoch_ends_with_the_weights_of_an_uninterrupted_one(work):
    work, _ = work
    command = (*TRAIN, "--run.name=killed", "--run.save-every=1")
    checkpoints = work / "runs" / "killed" / "checkpoints"
    with running(work, *command, **QUICK) as process:
        # A checkpoint that is still being written has more than a number for a name.
        wait_until((checkpoints / "1").is_dir, process)
        process.kill()
    assert not (checkpoints / "3").exists(), "it was in its second epoch already"
    assert "resuming" in run(work, *command)
    killed, whole = (work / "runs" / name for name in ("killed", "voxel_rcnn_small"))
    experiment = load_run(whole, DetectorRun).experiment
    shapes = jax.eval_shape(lambda: _create(experiment, 4, jax.random.key(0)))
    states = [Checkpoints(folder).restore("state", shapes) for folder in (killed, whole)]
    assert [int(state.step) for state in states] == [4, 4]
    jax.tree.map(np.testing.assert_array_equal, *states)
    # The lines of validation are the same, and the last one of the log but for what was seen since the line before.
    for own, other in zip(*(metrics(folder)[-2:] for folder in (killed, whole)), strict=True):
        assert own == other


def test_a_resumed_detector_must_learn_as_long(tmp_path):
    start_run(tmp_path, DetectorRun(EXPERIMENT, 100, 8))
    longer = replace(EXPERIMENT, optim=replace(EXPERIMENT.optim, epochs=90))
    with pytest.raises(ValueError, match=r"optim\.epochs was 80, now 90"):
        start_run(tmp_path, DetectorRun(longer, 100, 8))
