"""A small comparison, made without the package's effects: a flat road, a wall all round, a sensor with noise."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.discover.model.evidence import Measured, gather
from jaxsim.discover.model.null_model import fit_null
from jaxsim.effects import scan_of
from jaxsim.frame import PolarGrid, PolarImage

HEIGHT_M = 1.7
FAR_M = 0.08
"""What the sensor of `stages` (conftest) reads too far."""


def toy(frames: int = 6, rows: int = 16, columns: int = 60, *, seed: int = 0, gain: float = 0.0):
    """(scan, measured) with beam gains of standard deviation `gain`."""
    rng = np.random.default_rng(seed)
    elevation = np.linspace(0.03, -0.35, rows)
    azimuth = np.pi - (np.arange(columns) + 0.5) * 2 * np.pi / columns
    grid = PolarGrid(azimuth.astype(np.float32), elevation.astype(np.float32), np.zeros(rows, np.float32))
    images, more, about = [], [], []
    sensed = {"range_m": [], "intensity": [], "valid": []}
    gains = np.exp(rng.normal(0, gain, rows))[:, None] if gain else np.ones((rows, 1))
    for k in range(frames):
        wall = rng.uniform(8, 25)
        to_wall = np.broadcast_to((wall / np.cos(elevation))[:, None], (rows, columns))
        down = np.where(elevation < -1e-3, HEIGHT_M / -np.sin(np.minimum(elevation, -1e-3)), np.inf)[:, None]
        on_road = np.broadcast_to(down, (rows, columns)) < to_wall
        r = np.where(on_road, down, to_wall)
        angle = np.where(on_road, np.pi / 2 + elevation[:, None], np.abs(elevation)[:, None])
        semantic = np.where(on_road, 7, 11)
        shine = np.where(on_road, 0.2, 0.45) * np.cos(angle)
        valid = np.ones((rows, columns), bool)
        images.append(PolarImage(r.astype(np.float32), shine.astype(np.float32), valid))
        more.append({"incidence": angle.astype(np.float32), "semantic": semantic, "instance": np.zeros_like(semantic)})
        about.append({"time": 30.0 * k, "speed": 2.0 * k, "heading": 0.5 * k})
        back = rng.random((rows, columns)) > 0.01
        sensed["range_m"].append(np.where(back, r + rng.normal(0, 0.02, r.shape), 0))
        light = shine * rng.normal(1.2, 0.02) * gains * np.exp(rng.normal(0, 0.08, r.shape))
        sensed["intensity"].append(np.where(back, np.clip(light, 0, 1), 0))
        sensed["valid"].append(back)
    scan = scan_of(grid, images, more, about=about)
    return scan, Measured(*(np.stack(v).astype(np.float32 if n != "valid" else bool) for n, v in sensed.items()))


def device(*trees):
    return tuple(jax.tree.map(jnp.asarray, tree) for tree in trees)


def judged_toy(gain: float = 0.0):
    """(null problem, in_fit, scene) of nine toy frames, six of which find."""
    scan, measured = device(*toy(frames=9, gain=gain))
    frames = np.arange(9)
    ev = gather(scan, measured, frame=frames, column=np.broadcast_to(np.arange(0, 60, 2), (9, 30)), scene=frames)
    in_fit = (frames < 6).astype(np.float32)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        return fit_null(scan, ev, in_fit), in_fit, frames
