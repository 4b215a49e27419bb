"""What tests of gates are made of."""

import numpy as np

from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage

ROWS, COLUMNS = 8, 48


def write(folder, frames, scenes):
    azimuth = np.linspace(0.6, -0.6, COLUMNS).astype(np.float32)
    grid = PolarGrid(azimuth, np.linspace(0.0, -0.3, ROWS).astype(np.float32), np.zeros(ROWS, np.float32))
    write_grid(folder, grid, frames={f"{k:03d}": {"scene": scene} for k, scene in enumerate(scenes)})
    for k, (range_m, intensity) in enumerate(frames):
        write_frame(folder, f"{k:03d}", PolarImage(range_m, intensity, range_m > 0))


def sides(tmp_path, *, seed=0, scenes=8, noise=0.01, gain=1.0, lost=0.02, range_noise=0.01):
    """Two folders of one street a scene: the measured one noisy, brighter by `gain`, with losses."""
    rng = np.random.default_rng(seed)
    ours, theirs = [], []
    for _ in range(scenes):
        range_m = rng.uniform(3, 60, (ROWS, COLUMNS)).astype(np.float32)
        intensity = rng.uniform(0.1, 0.6, (ROWS, COLUMNS)).astype(np.float32)
        seen = np.where(rng.random((ROWS, COLUMNS)) < lost, 0, range_m + rng.normal(0, range_noise, range_m.shape))
        brighter = np.clip(intensity * gain + rng.normal(0, noise, intensity.shape), 0, 1)
        ours.append((range_m, intensity))
        theirs.append((seen.astype(np.float32), brighter.astype(np.float32)))
    names = [f"drive{k}" for k in range(scenes)]
    write(tmp_path / "simulated", ours, names)
    write(tmp_path / "measured", theirs, names)
    return tmp_path / "simulated", tmp_path / "measured"
