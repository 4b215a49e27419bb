"""Frames of the embedded world that gates are asked of: a simulator that is right, its sensor, and that sensor with one
effect more, which no code of the package put there.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.frame import PolarImage
from jaxsim.geometry import preset

STREETS = 16
POWER = 0.4
"""Of the range, with which intensity falls once the effect is there."""


def world_without_losses() -> SyntheticWorld:
    """The embedded world seen by an HDL-32E that loses no ray, counts in no steps and has no ceiling, for noise-free
    frames show none of these: what is left between the two sides is noise."""
    spec = replace(preset("hdl32e"), range_step_m=0.0, intensity_step=0.0)
    world = SyntheticWorld(spec=spec, columns=360)
    world.sensor = replace(
        world.sensor, threshold_m=1e4, glass_loss=0.0, paint_loss=0.0, retro_angle_rad=0.0, scale=0.5, offset=0.0
    )
    return world


def write_streets(folder: Path) -> None:
    """FOLDER/simulated: the report without noise; first and again: two measurements of it; changed: the first of these
    with the effect."""
    world = world_without_losses()
    about = {}
    for street in range(STREETS):
        # Four frames are of one street.
        index = 4 * street
        truth = world.truth(index)
        name = world.name_of(index)
        about[name] = {"scene": f"street{street:02d}"}
        met = truth.scan
        image = PolarImage(*(np.asarray(part) for part in (met.range_m, truth.image.intensity, truth.image.valid)))
        rasters = {
            "incidence": np.asarray(met.incidence_rad),
            "semantic": np.asarray(met.semantic).astype(np.uint8),
            "instance": np.asarray(met.instance),
        }
        write_frame(folder / "simulated", name, image, **rasters)
        measured = world.measure(index, truth)
        write_frame(folder / "first", name, measured)
        write_frame(folder / "again", name, world.measure(index, truth, repeat=1))
        fallen = measured.intensity * (12 / np.maximum(measured.range_m, 1)) ** POWER
        write_frame(folder / "changed", name, measured.replace(intensity=np.clip(fallen, 0, 1).astype(np.float32)))
    for side in ("simulated", "first", "again", "changed"):
        write_grid(folder / side, world.grid, frames=about)
