"""Scenes whose answer is known: a road, a wall across, a wall along, cast in plain NumPy."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.effects import Scan
from jaxsim.effects.scan import scan_of, slopes_of
from jaxsim.frame import PolarGrid, PolarImage

ROWS, COLUMNS = 24, 96
HEIGHT_M, AHEAD_M, LEFT_M = 1.7, 25.0, 9.0
ELEVATION = np.deg2rad(np.concatenate([np.linspace(4, -8, 16), np.linspace(-9, -24, 8)]))


def grid_of(turn: float = 2 * np.pi, rows: int = ROWS, columns: int = COLUMNS) -> PolarGrid:
    step = turn / columns
    azimuth = turn / 2 - step * (np.arange(columns) + 0.5)
    elevation = ELEVATION if rows == ROWS else np.deg2rad(np.linspace(2, -20, rows))
    return PolarGrid(azimuth.astype("f4"), elevation.astype("f4"), np.zeros(rows, "f4"))


def directions_of(azimuth, elevation):
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    ce = np.cos(elevation)
    return np.stack([ce * np.cos(azimuth), ce * np.sin(azimuth), np.sin(elevation)], -1)


def cast(direction, origin=(0.0, 0.0, 0.0)):
    """Range, class and cosine of incidence of the nearest of the planes; walls end at 6 m height."""
    origin = np.broadcast_to(origin, direction.shape)
    best = np.full(direction.shape[:-1], np.inf)
    semantic, cosine = np.zeros(best.shape, int), np.zeros(best.shape)
    planes = ((np.array([0, 0, -1.0]), HEIGHT_M, 7), (np.array([1.0, 0, 0]), AHEAD_M, 11),
              (np.array([0, 1.0, 0]), LEFT_M, 12))  # fmt: skip
    for normal, distance, name in planes:
        towards = (direction * normal).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (distance - (origin * normal).sum(-1)) / towards
            z = origin[..., 2] + t * direction[..., 2]
        met = (towards > 1e-9) & (t < best) & (z < 6 - HEIGHT_M) & (t < 120)
        best, semantic = np.where(met, t, best), np.where(met, name, semantic)
        cosine = np.where(met, towards, cosine)
    return best, semantic, cosine


def road_and_walls(grid: PolarGrid | None = None, frames: int = 1, **about) -> Scan:
    """The simulated scan of the scene, on the device."""
    grid = grid or grid_of()
    ray = directions_of(grid.azimuth_rad.astype(float)[None], grid.elevation_rad.astype(float)[:, None])
    range_m, semantic, cosine = cast(ray)
    hit = np.isfinite(range_m)
    image = PolarImage(np.where(hit, range_m, 0).astype("f4"), (0.4 * cosine).astype("f4"), hit)
    more = {"semantic": semantic, "incidence": np.where(hit, np.arccos(np.clip(cosine, 0, 1)), 0)}
    given = [{key: value[k] for key, value in about.items()} for k in range(frames)]
    return jax.tree.map(jnp.asarray, scan_of(grid, [image] * frames, [more] * frames, about=given))


def clutter_of_everything(seed: int = 0, frames: int = 2, rows: int = 5, columns: int = 14) -> Scan:
    """Random rays of every kind: no surface behind it, only numbers."""
    r = np.random.default_rng(seed)
    shape = (frames, rows, columns)

    def draw(low, high, size=shape):
        return r.uniform(low, high, size).astype("f4")

    grid, hit = grid_of(2.0, rows, columns), draw(0, 1) > 0.2
    range_m = np.where(hit, draw(2, 90), 0).astype("f4")
    return jax.tree.map(
        jnp.asarray,
        Scan(
            grid=grid,
            range_m=range_m,
            hit=hit,
            intensity=np.where(hit, draw(0.005, 1), 0).astype("f4"),
            incidence_rad=np.where(hit, draw(0, np.pi / 2), 0).astype("f4"),
            semantic=np.where(hit, r.choice([7, 11, 20, 26], shape), 0).astype("i4"),
            instance=r.integers(0, 5, shape, dtype="i4"),
            rgb=draw(0, 1, (*shape, 3)),
            phase=draw(0, 1),
            glare_m=draw(3, 50),
            glare_rad=np.where(draw(0, 1) > 0.5, np.pi, draw(0, 0.1)).astype("f4"),
            slopes=np.stack([slopes_of(grid, *frame) for frame in zip(range_m, hit, strict=True)]),
            time_s=np.linspace(0, 60, frames).astype("f4"),
            speed_mps=np.linspace(0, 12, frames).astype("f4"),
            heading_rad=np.linspace(0, 2, frames).astype("f4"),
        ),
    )


def fields_of(rays):
    """The arrays of rays by name."""
    return {name: value for name, value in rays.__dict__.items() if value is not None}
