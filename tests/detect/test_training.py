"""The detector learns: eight scenes by heart, the whole job as a user runs it, on one device or two."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxsim import devices
from jaxsim.detect.batches import SceneBatches
from jaxsim.detect.state import create_state
from jaxsim.detect.steps import make_train_step
from jaxsim.simulate import DetectorRun, main_scores, make_find, score_detector, start_run
from tests.detect.tiny import EXPERIMENT, VOXELS, scene, scene_batch

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_eight_scenes_are_learned_by_heart():
    """3D AP at overlap 0.7 of 95 and more: localisation, headings and scores, all of both stages, must work."""
    steps, scenes = 250, [scene(seed) for seed in range(8)]
    loader = SceneBatches(scenes, VOXELS, EXPERIMENT.augment, size=2, seed=0)
    state, train_step = create_state(EXPERIMENT, steps, seed=0), make_train_step(EXPERIMENT, steps)
    for k in range(steps):
        state, metrics = train_step(state, loader[k])
        assert bool(metrics["finite"])
    curves, _ = score_detector(make_find(EXPERIMENT), state.network, scenes, EXPERIMENT)
    scores = main_scores(curves)
    assert scores["AP_3d_moderate"].count == 48
    assert scores["AP_3d_moderate"].value >= 95, scores
    assert scores["AP_bev_moderate"].value >= 95, scores


@pytest.mark.slow
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


FLAGS = [
    "--data.train=0,8,20,24", "--data.validation=0,8", "--optim.epochs=2", "--run.log-every=1",
    "--voxels.max-voxels-train=3000", "--voxels.max-voxels=3000", "--augment.sampled=2",
    "--detector.train-proposals.after=16", "--detector.roi.rois=8", "--detector.roi.grid=3",
    "--detector.backbone.widths", "4", "4", "4", "4", "--detector.backbone.out=4",
]  # fmt: skip


def run(work, *command):
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "XLA_FLAGS": "", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *command], cwd=work, env=environment, text=True, capture_output=True, timeout=3000
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_detector_is_trained_resumed_scored_and_used(tmp_path):
    train = str(ROOT / "train.py"), "voxel_rcnn_small", *FLAGS
    run(tmp_path, *train)
    folder = tmp_path / "runs" / "voxel_rcnn_small"
    assert {"config.json", "checkpoints", "metrics.jsonl", "figures", "card.md"} <= {p.name for p in folder.iterdir()}
    lines = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines if "loss/total" in line] == [1, 2, 3, 4]
    assert [line["step"] for line in lines if "validation/AP_3d_moderate" in line] == [2, 4]
    assert all("dropped/voxels" in line for line in lines if "loss/total" in line)
    assert sorted(p.name for p in (folder / "checkpoints").iterdir() if p.name.isdigit()) == ["2", "4"]

    assert "resuming" in run(tmp_path, *train)
    said = run(tmp_path, str(ROOT / "eval.py"), str(folder))
    assert "mean (and standard deviation) of the last 2 checkpoints" in said
    assert (folder / "evaluation" / "detection.json").is_file()
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    scene(0).points.tofile(clouds / "one.bin")
    run(tmp_path, "-m", "jaxsim.cli", "detect", str(folder), "--clouds", str(clouds), "--out", str(tmp_path / "out"))
    assert (tmp_path / "out" / "results" / "one.txt").is_file()


def test_a_resumed_detector_must_learn_as_long(tmp_path):
    start_run(tmp_path, DetectorRun(EXPERIMENT, 100, 8))
    longer = replace(EXPERIMENT, optim=replace(EXPERIMENT.optim, epochs=90))
    with pytest.raises(ValueError, match=r"--optim\.epochs was 80, now 90"):
        start_run(tmp_path, DetectorRun(longer, 100, 8))
