"""What a training step costs, from the program itself: operations, and what devices send one another.

    python benchmarks/speed/on_paper.py [kitti_raw | kitti_step_combined | voxel_rcnn_car ...] [--batch 8]

No step runs. Operations and the bytes touched are those of the lowered program (`Lowered.cost_analysis`, before
fusion: an upper bound of the memory's traffic). The body of a loop counts once, whatever its rounds: of a detector's
sparse convolutions, which go through a kernel's 27 cells in turn, one cell. Devices exchange the mean of all gradients
once a step: in a ring of n each sends 2 (n - 1) / n times their bytes. Times stand for a device and links of the given
speed at the given share of its peak; they leave out that the exchange runs beside the backward pass, so the share of
communication is an upper bound. Perceptual losses, whose weights are not part of jaxsim, are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

import jax
import jax.numpy as jnp
import tyro

from jaxsim.config import DetectorExperiment, Experiment
from jaxsim.detect import make_train_step as make_detector_step
from jaxsim.detect.steps import _create
from jaxsim.pix2pix import make_train_step, state_shapes
from jaxsim.prepare import input_channels
from jaxsim.train.experiments import load_experiment

ROOM = 16
"""Objects that a detector's batch has room for in a scene."""


@dataclass(frozen=True)
class Args:
    """Which step, and what it runs on."""

    configs: Annotated[tuple[str, ...], tyro.conf.Positional] = ("kitti_raw", "kitti_step_combined", "voxel_rcnn_car")
    """Experiments of configs/."""
    batch: int = 1
    """Items a device; a detector's step takes two or more."""
    devices: tuple[int, ...] = (8, 64)
    """How many share a step."""
    peak: float = 67e12
    """Operations a second of a device: of an H100 SXM in float32, without tensor cores."""
    used: float = 0.3
    """Share of it that a step reaches."""
    link: float = 50e9
    """Bytes a second that a device sends: of a 400 Gb/s network, a card each."""


def intensity_step(experiment: Experiment, batch: int) -> tuple[Any, tuple[Any, ...], Any]:
    """The step, the shapes of its arguments, and the parameters whose gradients are exchanged."""
    experiment = replace(experiment, loss=replace(experiment.loss, perceptual=0.0))
    channels, size = input_channels(experiment.prepare), experiment.prepare.network_size
    state = state_shapes(experiment, channels)
    raster = lambda c: jax.ShapeDtypeStruct((batch, *size, *c), jnp.float32)  # noqa: E731
    arrays = {"inputs": raster((channels,)), "target": raster((1,)), "weight": raster(())}
    judges = state.discriminator.parameters if state.discriminator else ()
    return make_train_step(experiment, channels), (state, arrays), (state.generator.parameters, judges)


def detector_step(experiment: DetectorExperiment, batch: int) -> tuple[Any, tuple[Any, ...], Any]:
    """As `intensity_step`."""
    state = jax.eval_shape(lambda: _create(experiment, 1000, jax.random.key(0)))
    points = experiment.voxels.max_points
    of = lambda kind, *shape: jax.ShapeDtypeStruct((batch, *shape), kind)  # noqa: E731
    arrays = {
        "points": of(jnp.float32, points, 4),
        "valid": of(jnp.bool_, points),
        "objects": of(jnp.float32, ROOM, 7),
        "is_object": of(jnp.bool_, ROOM),
        "dropped_points": of(jnp.int32),
    }
    return make_detector_step(experiment, 1000), (state, arrays), state.network.parameters


def main(args: Args) -> None:
    # The forms of a GPU: those of a CPU do the same sums with fewer, or other, operations.
    jax.default_backend = lambda: "cuda"
    for name in args.configs:
        experiment, _ = load_experiment(name)
        if isinstance(experiment, DetectorExperiment):
            batch = max(args.batch, 2)
            step, shapes, exchanged = detector_step(experiment, batch)
        elif isinstance(experiment, Experiment):
            batch = args.batch
            step, shapes, exchanged = intensity_step(experiment, batch)
        else:
            raise SystemExit(f"{name} is neither an intensity network nor a detector")
        lowered = jax.jit(step).lower(*shapes)
        cost = lowered.cost_analysis() or {}
        flops = cost["flops"]
        gradients = sum(4 * math.prod(leaf.shape) for leaf in jax.tree.leaves(exchanged))
        print(
            f"{name}, {batch} a device: {flops / 1e12:.3f} T operations a step, {gradients / 2**20:.0f} MiB gradients"
        )
        print(f"  {cost['bytes accessed'] / 2**30:.1f} GiB touched before fusion")
        compute_s = flops / (args.peak * args.used)
        for n in args.devices:
            sent = 2 * (n - 1) / n * gradients
            exchange_s = sent / args.link
            share = exchange_s / (compute_s + exchange_s)
            print(
                f"  {n} devices: {1e3 * compute_s:.1f} ms of operations, {sent / 2**20:.0f} MiB sent by each in "
                f"{1e3 * exchange_s:.1f} ms: {100 * share:.0f} %, {n * batch / (compute_s + exchange_s):.0f} items/s"
            )


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
