"""One training step and one detection of Voxel R-CNN: seconds, scans a second, memory.

    python benchmarks/speed/voxel_rcnn.py [voxel_rcnn_car | voxel_rcnn_small] [--batch 2] [--steps 3]

Scenes are frames of the embedded world, as dense ahead of the car as KITTI's. Memory is the process's highest resident
set (on a GPU: the device's highest allocation), compilation told apart.
"""

from __future__ import annotations

import resource
import time
from dataclasses import dataclass, replace
from typing import Annotated

import jax
import numpy as np
import tyro

from jaxsim import detect
from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import DataConfig, DetectorExperiment
from jaxsim.data import open_dataset
from jaxsim.detect.scenes import scene_of_frame
from jaxsim.evaluate.detector import make_find
from jaxsim.train.experiments import load_experiment


@dataclass(frozen=True)
class Args:
    """What to time."""

    config: Annotated[str, tyro.conf.Positional] = "voxel_rcnn_car"
    """A detector of configs/."""
    batch: int = 2
    """Scenes a step."""
    steps: int = 3
    """Steps and detections to time, after one that is not."""


def memory_gib() -> float:
    """Highest use so far."""
    device = jax.local_devices()[0]
    stats = device.memory_stats() if device.platform != "cpu" else None
    return stats["peak_bytes_in_use"] / 2**30 if stats else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def main(args: Args) -> None:
    experiment, _ = load_experiment(args.config)
    assert isinstance(experiment, DetectorExperiment)
    experiment = replace(experiment, optim=replace(experiment.optim, batch=args.batch))
    world = open_dataset(DataConfig())
    scenes = [
        scene_of_frame(world[8 * k], experiment.detector.anchors.kind, in_image=True) for k in range(2 * args.batch)
    ]
    loader = detect.SceneBatches(scenes, experiment.voxels, experiment.augment, size=args.batch, seed=0)
    points = [len(scene.points) for scene in scenes]
    print(f"{jax.devices()[0].device_kind}, {args.config}, batch {args.batch}, {np.mean(points):.0f} points a scene")
    print(f"before: {memory_gib():.2f} GiB")

    begun, cpu = time.monotonic(), time.process_time()
    state = detect.create_state(experiment, 1000, seed=0)
    step = detect.make_train_step(experiment, 1000)
    state, metrics = step(state, loader[0])
    jax.block_until_ready(metrics)
    took, used = time.monotonic() - begun, time.process_time() - cpu
    print(f"compilation and first step: {took:.1f} s ({used:.1f} s of processor time), {memory_gib():.2f} GiB")
    timed("training step", lambda k: step_once(step, state, loader[k]), args.steps, args.batch)
    print(f"highest memory in training: {memory_gib():.2f} GiB")
    left_out = {name: int(value) for name, value in metrics.items() if name.startswith("dropped/") and int(value)}
    print(f"left out for want of room: {left_out or 'nothing'}")

    find = make_find(experiment)
    network = jax.tree.map(np.asarray, detect.create_state(experiment, 1000, seed=0).network)
    find(network, scenes[0].points)
    timed("detection", lambda k: find(network, scenes[k % len(scenes)].points), args.steps, 1)


def step_once(step, state, batch) -> None:
    """A step on a copy: the step takes its state away."""
    _, metrics = step(jax.tree.map(lambda leaf: leaf.copy(), state), batch)
    jax.block_until_ready(metrics)


def timed(name: str, run, times: int, scans: int) -> None:
    """Medians of wall and processor seconds."""
    walls, used = [], []
    for k in range(times):
        begun, cpu = time.monotonic(), time.process_time()
        run(k)
        walls.append(time.monotonic() - begun)
        used.append(time.process_time() - cpu)
    wall, cpu = float(np.median(walls)), float(np.median(used))
    print(f"{name}: {wall:.2f} s, {cpu:.2f} s of processor time, {scans / wall:.2f} scans/s")


if __name__ == "__main__":
    enable_compilation_cache()
    main(tyro.cli(Args, description=__doc__))
