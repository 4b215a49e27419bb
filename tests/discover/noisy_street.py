"""A road between two walls as a simulator with noise of its own renders it, cast and disturbed in plain NumPy."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.read import Comparison
from jaxsim.effects import Scan, scan_of
from jaxsim.frame import PolarGrid, PolarImage

ROWS, COLUMNS = 24, 480
HEIGHT_M, WALLS_M = 1.7, (6.0, -9.0)
TEXTURE = {7: 0.0, 11: 0.15}
"""Standard deviation of ln albedo in squares of 2 m: the road has none."""


def grid() -> PolarGrid:
    azimuth = np.pi - (np.arange(COLUMNS) + 0.5) * 2 * np.pi / COLUMNS
    elevation = np.deg2rad(np.linspace(3, -20, ROWS))
    return PolarGrid(azimuth.astype("f4"), elevation.astype("f4"), np.zeros(ROWS, "f4"))


def street(seed: int) -> dict[str, np.ndarray]:
    """One frame without noise: range, intensity, semantic, incidence, hit."""
    rng = np.random.default_rng(seed)
    at = grid()
    azimuth, elevation = at.azimuth_rad.astype(float)[None], at.elevation_rad.astype(float)[:, None]
    flat = np.cos(elevation)
    with np.errstate(divide="ignore"):
        ground = np.where(elevation < 0, HEIGHT_M / -np.sin(np.minimum(elevation, -1e-9)), np.inf)
        walls = [w / (flat * np.sin(azimuth)) for w in WALLS_M]
    walls = np.min([np.where(w > 0, w, np.inf) for w in walls], axis=0)
    range_m = np.minimum(ground, walls)
    road = ground < walls
    cosine = np.where(road, -np.sin(elevation), np.abs(flat * np.sin(azimuth)))
    hit = range_m < 80
    x, z = range_m * flat * np.cos(azimuth), range_m * np.sin(elevation)
    square = rng.normal(0, 1, (400, 40))
    texture = square[
        np.floor(np.where(hit, x, 0) / 2).astype(int) % 400, np.floor(np.where(hit, z, 0)).astype(int) % 40
    ]
    albedo = np.where(road, 0.15, 0.35) * np.exp(np.where(road, TEXTURE[7], TEXTURE[11]) * texture)
    return {
        "range": np.where(hit, range_m, 0),
        "intensity": np.where(hit, albedo * cosine, 0),
        "semantic": np.where(road, 7, 11),
        "incidence": np.where(hit, np.arccos(np.clip(cosine, 0, 1)), 0),
        "hit": hit,
    }


def disturbed(frame, rng, *, share=0.0, constant=0.0, range_m=0.0, loss=0.0, step=0.0):
    """Range, intensity and returns of a frame with noise."""
    shape = frame["hit"].shape
    kept = frame["hit"] & (rng.random(shape) >= loss)
    intensity = frame["intensity"] * (1 + share * rng.normal(size=shape)) + constant * rng.normal(size=shape)
    intensity = np.round(np.clip(intensity, 0, 1) / step) * step if step else np.clip(intensity, 0, 1)
    reading = frame["range"] + range_m * rng.normal(size=shape)
    return np.where(kept, reading, 0), np.where(kept, intensity, 0), kept


def scan(noise=None, frames: int = 4, seed: int = 0) -> tuple[Scan, list[dict[str, np.ndarray]]]:
    """The simulated scan (device memory), and its frames without noise."""
    rng = np.random.default_rng(1000 + seed)
    truth = [street(seed + k) for k in range(frames)]
    images, more = [], []
    for frame in truth:
        range_m, intensity, kept = disturbed(frame, rng, **(noise or {}))
        images.append(PolarImage(range_m.astype("f4"), intensity.astype("f4"), kept))
        more.append({"semantic": frame["semantic"], "incidence": frame["incidence"].astype("f4")})
    return jax.tree.map(jnp.asarray, scan_of(grid(), images, more)), truth


def sensed(truth, noise, seed: int = 7) -> Measured:
    """What a sensor with noise reads of the same frames."""
    rng = np.random.default_rng(seed)
    parts = [disturbed(frame, rng, **noise) for frame in truth]
    return Measured(*(np.stack([part[k] for part in parts]).astype(bool if k == 2 else "f4") for k in range(3)))


def comparison(simulated, measured, frames: int = 12) -> Comparison:
    """Both sides of as many streets, one a scene."""
    scans, truth = scan(simulated, frames)
    names = tuple(f"{k:03d}" for k in range(frames))
    return Comparison(jax.tree.map(np.asarray, scans), sensed(truth, measured), names, names)
