"""Runs that never trained: their folder, and a random network. For tests of the way, not of the answer."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxsim.config import DetectorExperiment, Experiment
from jaxsim.data.synthetic import kitti_camera
from jaxsim.detect import network_shapes
from jaxsim.frame import CameraFrame
from jaxsim.geometry import preset
from jaxsim.pix2pix import state_shapes
from jaxsim.prepare import input_channels
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints, describe_run, start_run
from jaxsim.train.experiments import load_experiment


def tiny_experiment(**data: Any) -> Experiment:
    """The embedded world's experiment at few columns and filters; its data with these values changed."""
    base, _ = load_experiment("synthetic")
    assert isinstance(base, Experiment)
    return replace(
        base,
        data=replace(base.data, **data),
        prepare=replace(base.prepare, columns=64, network_size=(64, 128)),
        generator=replace(base.generator, filters=4, blocks=1, downsamples=2, enhancer_blocks=1),
        discriminator=replace(base.discriminator, filters=4, max_filters=8),
    )


def untrained_run(folder: Path, experiment: Experiment, *, seed: int = 0, view: CameraFrame | None = None) -> Path:
    """Makes the folder; without another `view`, its camera is KITTI's."""
    view = view or CameraFrame(np.zeros((375, 1242, 3), np.uint8), kitti_camera())
    start_run(folder, describe_run(experiment, preset("hdl64e"), view))
    shapes = state_shapes(experiment, input_channels(experiment.prepare)).ema
    rng = np.random.default_rng(seed)
    weights = jax.tree.map(lambda leaf: rng.normal(0, 0.1, leaf.shape).astype(leaf.dtype), shapes)
    Checkpoints(folder, keep=1).save(1, state={"step": np.int32(1)}, generator=weights)
    return folder


def untrained_detector(folder: Path, experiment: DetectorExperiment, *, seed: int = 0) -> Path:
    """Makes the folder of a detector; variances are 1."""
    start_run(folder, DetectorRun(experiment, 1, 1))
    rng = np.random.default_rng(seed)

    def draw(path, leaf):
        if "variance" in jax.tree_util.keystr(path):
            return np.ones(leaf.shape, leaf.dtype)
        return rng.normal(0, 0.1, leaf.shape).astype(leaf.dtype)

    network = jax.tree_util.tree_map_with_path(draw, network_shapes(experiment))
    Checkpoints(folder, keep=1).save(1, state={"step": np.int32(1)}, network=network)
    return folder
