"""Polar frames by Lambert's law on measured ranges: `python docs/lambert.py MEASURED SIMULATED`.

Every surface has albedo 0.3 and no gloss, whatever its distance: the plainest simulator there is.
"""

import sys

import numpy as np

from jaxsim.data.polar_frames import open_polar_frames, write_frame, write_grid
from jaxsim.geometry import incidence

measured, simulated = sys.argv[1:]
frames = open_polar_frames(measured)
for name in frames.names:
    image, rasters = frames.read(name)
    labels = {key: rasters[key] for key in ("semantic", "instance") if key in rasters}
    angle, known = (np.asarray(raster) for raster in incidence(image.range_m, image.valid, frames.grid))
    # Where no neighbour tells how a surface lies, it is seen at a slant of 60 degrees.
    shade = np.where(known, np.cos(angle), np.float32(0.5))
    angle = np.where(known, angle, np.float32(np.pi / 2))
    write_frame(simulated, name, image.replace(intensity=0.3 * shade), incidence=angle, **labels)
write_grid(simulated, frames.grid, frames=frames.about)
