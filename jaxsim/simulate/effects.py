"""Effects of a sensor model on simulated frames."""

from __future__ import annotations

import warnings
from dataclasses import replace

import jax
import numpy as np

from jaxsim.effects import scan_of
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import Array, Painted, PolarGrid, PolarImage
from jaxsim.simulate.beside_drive import rasters

NEEDS = {"emitter_drift": "time", "ambient_light": "heading", "motion_distortion": "speed"}
"""Effects that act by what a frame says of itself."""
DIRECTED = ("ambient_light",)
"""Those that act elsewhere where it does not; the others then do nothing."""


def with_effects(
    model: SensorModel,
    image: PolarImage,
    painted: Painted,
    grid: PolarGrid,
    *,
    key: Array,
    time_s: float | None = None,
    speed_mps: float | None = None,
    heading_rad: float | None = None,
) -> PolarImage:
    """One simulated frame (rows, columns) as a sensor with these effects reports it (host memory).

    `time_s` counts from the recording's first frame, speed and heading are as in `Frame`. The effects see what the
    polar frame's file holds, so that effects which `discover` found in files act here on the same rays. Raises and
    warns as `check_motion`.
    """
    check_motion(model, time_s=time_s, speed_mps=speed_mps, heading_rad=heading_rad)
    about = {"speed": speed_mps or 0.0, "heading": heading_rad or 0.0}
    scan = scan_of(grid, [jax.tree.map(np.asarray, image)], [rasters(painted, grid)], about=[about])
    scan = replace(scan, time_s=np.full(1, time_s or 0.0, np.float32))
    return jax.tree.map(lambda leaf: leaf[0], model.simulate(scan, key))


def check_motion(
    model: SensorModel, *, time_s: float | None, speed_mps: float | None, heading_rad: float | None
) -> None:
    """Warns of effects that do nothing because a frame does not say how the car moves, or when it was taken.

    Raises ValueError for an effect that acts in a direction of the world on a frame that does not say where the car
    heads: it would act in the wrong one.
    """
    known = {"time": time_s, "speed": speed_mps, "heading": heading_rad}
    for name, what in ((name, NEEDS[name]) for name, _ in model.effects if name in NEEDS):
        if known[what] is not None:
            continue
        if name in DIRECTED:
            raise ValueError(
                f"simulate: {name} of the sensor model acts in a direction of the world, and these frames do not say "
                "where the car heads; take frames that do (kitti_raw with its oxts/, synthetic), or take the effect "
                "out of sensor.json"
            )
        warnings.warn(
            f"simulate: {name} of the sensor model does nothing here: these frames do not say their {what} (kitti_raw "
            "has it in oxts/data and velodyne_points/timestamps.txt)",
            stacklevel=1,
        )
