"""Runs of one small U-Net each, which differ in their seed: their folders, without a training."""

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.config import Experiment, GeneratorConfig, LossConfig, OptimConfig, PrepareConfig, RunConfig
from jaxsim.frame import Camera, CameraFrame
from jaxsim.geometry import preset
from jaxsim.pix2pix import create_state
from jaxsim.runs.run import Checkpoints, describe_run, start_run

VIEW = CameraFrame(
    np.zeros((375, 1242, 3), np.uint8),
    Camera(np.diag([700, 700, 1]).astype(np.float32), np.eye(4, dtype=np.float32)),
)
EXPERIMENT = Experiment(
    prepare=PrepareConfig(inputs=("rgb",), network_size=(8, 16)),
    generator=GeneratorConfig(form="unet", filters=4, downsamples=1, blocks=1, enhancers=0),
    loss=LossConfig(gan=0.0, feature_matching=0.0, reconstruction=1.0),
    optim=OptimConfig(batch=2, lr=1e-2, eps=1e-15, ema_start=100),
)
CHANNELS = 3


def trained_apart(folder: Path, seed: int, *, step: int = 5, **changes) -> Path:
    """A run at a step, with the state that its seed begins with."""
    run = RunConfig(name=folder.name, out=folder.parent, seed=seed)
    experiment = replace(EXPERIMENT, run=run, **changes)
    start_run(folder, describe_run(experiment, preset("hdl64e"), VIEW))
    state = create_state(experiment, CHANNELS, seed).replace(step=jnp.int32(step))
    Checkpoints(folder).save(step, state=state, generator=state.ema)
    return folder


@pytest.fixture
def runs(tmp_path) -> list[Path]:
    """Three of them, at step 5."""
    return [trained_apart(tmp_path / name, seed) for seed, name in enumerate(("first", "second", "third"))]
