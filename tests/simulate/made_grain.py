"""Fields, and what a sensor with them would measure, made by loops and blocks: code that shares nothing with ours."""

import numpy as np
from scipy.stats import norm

from jaxsim.config import QUANTILES
from jaxsim.frame import Painted
from jaxsim.simulate.grain import breaks_of
from jaxsim.simulate.grain_fit import GrainScan

SHAPE = (32, 128)


def by_loops(random: np.random.Generator, *, columns: float, rows: float, wall: int | None = None) -> np.ndarray:
    """A field of first order in both directions, cell after cell; from column `wall` on it is another one."""
    z = random.normal(size=SHAPE)
    along, down = np.exp(-1 / columns), np.exp(-1 / rows)
    for c in range(1, SHAPE[1]):
        if c != wall:
            z[:, c] = along * z[:, c - 1] + np.sqrt(1 - along**2) * z[:, c]
    for r in range(1, SHAPE[0]):
        z[r] = down * z[r - 1] + np.sqrt(1 - down**2) * z[r]
    return z


def in_blocks(random: np.random.Generator, *, share: float) -> np.ndarray:
    """z of which a share belongs to blocks of 4 x 8 cells and the rest to each cell."""
    blocks = random.normal(size=(SHAPE[0] // 4, SHAPE[1] // 8)).repeat(4, 0).repeat(8, 1)
    return np.sqrt(share) * blocks + np.sqrt(1 - share) * random.normal(size=SHAPE)


def ranges(wall: int | None = None) -> np.ndarray:
    """Of a plane 10 m to the side of a sensor that looks along it; from column `wall` on of one at 15 m."""
    azimuth = np.linspace(0.6, 1.2, SHAPE[1])
    away = np.where(np.arange(SHAPE[1]) < (SHAPE[1] if wall is None else wall), 10.0, 15.0)
    return np.broadcast_to(away / np.sin(azimuth), SHAPE).astype(np.float32)


def painted(range_m: np.ndarray, *, semantic: np.ndarray | None = None, valid: np.ndarray | None = None) -> Painted:
    nothing, every = np.zeros(range_m.shape, np.int32), np.ones(range_m.shape, bool)
    rgb = np.zeros((*range_m.shape, 3), np.float32)
    kind = nothing if semantic is None else semantic
    return Painted(range_m, range_m, rgb, kind, nothing, every if valid is None else valid, ~every)


def quantiles() -> np.ndarray:
    """Those of a normal number about 0.4, which differ from cell to cell in width."""
    width = np.linspace(0.05, 0.1, SHAPE[1])[None, :, None]
    return np.broadcast_to(0.4 + width * norm.ppf(QUANTILES), (*SHAPE, len(QUANTILES))).astype(np.float32)


def drop_shares() -> np.ndarray:
    return np.broadcast_to(np.linspace(0.1, 0.6, SHAPE[0])[:, None], SHAPE).astype(np.float32)


def scan(z: np.ndarray, of_drop: np.ndarray, *, wall: int | None = None) -> GrainScan:
    """What a sensor reports whose intensities and drops have these normal numbers, beside a network that knows it."""
    view, told, u = painted(ranges(wall)), quantiles(), norm.cdf(z)
    cells = zip(u.ravel(), told.reshape(-1, len(QUANTILES)), strict=True)
    # Between its outer quantiles as told; beyond them no further, which few cells are.
    value = np.array([np.interp(rank, QUANTILES, of_cell) for rank, of_cell in cells]).reshape(SHAPE)
    back = norm.cdf(of_drop) >= drop_shares()
    on = breaks_of(view.range_m, view.valid, kind=view.semantic, thing=view.instance)
    return GrainScan(on, view.valid, back, value.astype(np.float32), told, drop_shares())


def beside(z: np.ndarray, lag: int, axis: int = 1) -> float:
    """Correlation of cells so far apart."""
    z = np.moveaxis(z, axis, -1)
    return float(np.corrcoef(z[..., :-lag].ravel(), z[..., lag:].ravel())[0, 1])
