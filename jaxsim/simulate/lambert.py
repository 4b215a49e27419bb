"""The plainest simulator there is, for whoever has none yet: Lambert's law on the very ranges that were measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxsim.data.polar_frames import open_polar_frames, write_frame, write_grid
from jaxsim.geometry import incidence
from jaxsim.simulate.frames import refuse_others

REFLECTANCE = np.float32(0.3)
"""Of every surface, whatever its distance, and without gloss."""
SLANT_COS = np.float32(0.5)
"""Where no neighbour tells how a surface lies: it is seen at a slant of 60 degrees."""


def write_lambert(measured: Path, out: Path) -> Path:
    """Writes what Lambert's law says of a folder's polar frames to OUT/simulated, and returns that folder.

    Ranges, returns and labels are the measured ones; the incidence is that of the range image, and a right angle where
    that does not tell it. Raises ValueError where OUT/simulated is the measured folder, or holds other frames.
    """
    simulated = out / "simulated"
    if simulated.resolve() == measured.resolve():
        raise ValueError(f"discover: --lambert would write over the measured frames in {measured}; give another --out")
    frames = open_polar_frames(measured)
    refuse_others(simulated, frames.names)
    for name in frames.names:
        image, rasters = frames.read(name)
        labels = {key: rasters[key] for key in ("semantic", "instance") if key in rasters}
        angles, where = incidence(image.range_m, image.valid, frames.grid)
        angle = np.asarray(angles)
        has_normal = np.asarray(where)
        shade = np.where(has_normal, np.cos(angle), SLANT_COS)
        # Shaded as at 60 degrees, yet told as a right angle: that stands for what cannot be told in training pairs,
        # too.
        angle = np.where(has_normal, angle, np.float32(np.pi / 2))
        write_frame(simulated, name, replace(image, intensity=REFLECTANCE * shade), incidence=angle, **labels)
    write_grid(simulated, frames.grid, frames=frames.about)
    return simulated
