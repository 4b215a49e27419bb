"""The detector learns: eight scenes by heart, the whole job as a user runs it, on one device or two."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim import devices
from jaxsim.detect.batches import SceneBatches
from jaxsim.detect.state import create_state
from jaxsim.detect.steps import make_train_step
from jaxsim.evaluate.detector import main_scores, make_find, score_detector
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints, load_run, start_run
from tests.detect.tiny import EXPERIMENT, VOXELS, scene, scene_batch
from tests.programs import ROOT, running, said, wait_until


@pytest.mark.slow
def test_eight_scenes_are_learned_by_heart():
    """3D AP at overlap 0.7 of 95 and more: localisation, headings and scores, all of both stages, must work."""
    steps, scenes = 250, [scene(seed) for seed in range(8)]
    loader = SceneBatches(scenes, VOXELS, EXPERIMENT.augment, size=2, seed=0)
    state, train_step = create_state(EXPERIMENT, steps, seed=0), make_train_step(EXPERIMENT, steps)
    for k in range(steps):
        state, metrics = train_step(state, loader[k])
        assert bool(metrics["finite"])
    curves, _ = score_detector(make_find(EXPERIMENT), state.network, scenes, experiment=EXPERIMENT)
    scores = main_scores(curves)
    assert scores["AP_3d_moderate"].count == 48
    assert scores["AP_3d_moderate"].value >= 95, scores
    assert scores["AP_bev_moderate"].value >= 95, scores


@pytest.mark.slow
@pytest.mark.usefixtures("quick_compile")
def test_two_devices_learn_what_one_does():
    state = jax.tree.map(np.asarray, create_state(EXPERIMENT, 50, seed=0))
    batch, mesh = scene_batch([0, 1]), devices.data_mesh(2)
    assert mesh is not None
    alone, wanted = make_train_step(EXPERIMENT, 50)(state, batch)
    step = make_train_step(EXPERIMENT, 50, mesh=mesh)
    shared, metrics = step(devices.everywhere(mesh, state), devices.cut(mesh, batch))
    for name, value in wanted.items():
        np.testing.assert_allclose(np.asarray(metrics[name], float), float(value), rtol=1e-4, err_msg=name)
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-5),
        shared.network.statistics,
        alone.network.statistics,
    )
    # After one step Adam's first moment is (1 - beta) of the clipped gradient: sharding must not change it.
    for (path, own), other in zip(
        jax.tree_util.tree_flatten_with_path(alone.optim["first"])[0],
        jax.tree.leaves(shared.optim["first"]),
        strict=True,
    ):
        own, name = np.asarray(own), jax.tree_util.keystr(path)
        np.testing.assert_allclose(other, own, rtol=1e-3, atol=1e-3 * np.abs(own).max(), err_msg=name)
    assert any(np.asarray(leaf).any() for leaf in jax.tree.leaves(alone.optim["first"]))


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
    run(work, "-m", "jaxsim.cli", "detect", str(folder), "--clouds", str(clouds), "--out", str(work / "out"))
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
    shapes = jax.eval_shape(lambda: create_state(load_run(whole, DetectorRun).experiment, 4, seed=0))
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
