"""What people have for a simulator of a street that was scanned: digital twins of real scans.

    patches    surfaces smoothed as a mesh is, a centimetre off in places, with the albedo of patches, noise, 8 bits
    trees      the scan's own surfaces, with intensities that boosted trees learned on two thirds of the other drives

Both lack the sensor's scatter, and what a smooth surface or a tree does not tell of paint and leaves; trees do not know
the azimuth. NumPy and scikit-learn alone; shapes are (rows, columns), a range of 0 is no surface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from threadpoolctl import threadpool_limits

from benchmarks.blind.hidden.frames import Grid
from benchmarks.blind.hidden.replay import Scan, incidence_of

Image = Float[np.ndarray, "r c"]
Frame = dict[str, Image]
SMOOTH, PATCH = 3, 4
"""Columns to each side over which surfaces are smoothed, and albedo is."""
SAME_RANGE, SAME_SURFACE = 0.03, 0.05
"""Share of the range by which neighbours may differ and be smoothed, or be one patch."""
MESH_M, MESH_CELLS = 0.01, (1.0, 4.0)
"""By how much, and over how many rows and columns, a mesh is off."""
NOISE = {"range_m": 0.006, "share": 0.04, "flat": 0.003}
"""Of `patches`: of ranges, and of intensities as a share and beside it."""
GROUPS = 3
"""Trees of a group of drives learn on the others."""
LEARNED_RAYS, TREES = 200_000, 150


def patches(scans: Mapping[str, Scan], grid: Grid, *, seed: int) -> list[Frame]:
    """Every scan as a mesh with the albedo of patches shows it."""
    del grid
    frames = []
    for number, scan in enumerate(scans.values()):
        rng = np.random.default_rng([seed, number])
        noise = {name: sd * rng.normal(size=scan.range_m.shape) for name, sd in NOISE.items()}
        there = scan.range_m > 0
        mesh = smoothed(scan.range_m) + mesh_error(there.shape, rng) + noise["range_m"]
        level = patch_means(scan.intensity, scan.range_m) * (1 + noise["share"]) + noise["flat"]
        frames.append({"range": np.where(there, mesh, 0), "intensity": np.where(there, rounded(level), 0)})
    return frames


def trees(scans: Mapping[str, Scan], grid: Grid, *, seed: int) -> list[Frame]:
    """Every scan with the intensities that trees of other drives give its surfaces.

    Raises ValueError where there are fewer drives than groups.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    drive = [name.rpartition(" quarter ")[0] for name in scans]
    drives = sorted({*drive})
    if len(drives) < GROUPS:
        raise ValueError(f"twins: {len(drives)} drives; trees of one group learn on two others: give {GROUPS} or more")
    group = np.array([drives.index(name) % GROUPS for name in drive])
    model = HistGradientBoostingRegressor(max_iter=TREES, max_leaf_nodes=48, min_samples_leaf=40, random_state=seed)
    # Threads of OpenMP spin, and take the cores of whatever else is running.
    with threadpool_limits(limits=1, user_api="openmp"):
        return _by_trees(scans, grid, group, model=model, seed=seed)


def _by_trees(
    scans: Mapping[str, Scan], grid: Grid, group: Int[np.ndarray, " n"], *, model: Any, seed: int
) -> list[Frame]:
    """The scans of each group by a model that learns on the others."""
    from sklearn.base import clone

    seen = [features(scan, grid) for scan in scans.values()]
    there = [scan.range_m > 0 for scan in scans.values()]
    learned = []
    for left_out in range(GROUPS):
        others = np.flatnonzero(group != left_out)
        x = np.concatenate([seen[k][there[k]] for k in others])
        y = np.concatenate([scan.intensity[scan.range_m > 0] for k, scan in enumerate(scans.values()) if k in others])
        some = np.random.default_rng([seed, left_out]).permutation(len(x))[:LEARNED_RAYS]
        learned.append(clone(model).fit(x[some], y[some]))
    frames = []
    for scan, of, look, hit in zip(scans.values(), group, seen, there, strict=True):
        mean = learned[of].predict(look.reshape(-1, look.shape[-1])).reshape(hit.shape)
        frames.append({"range": scan.range_m, "intensity": np.where(hit, np.clip(mean, 0, 1), 0)})
    return frames


TWINS: dict[str, Callable[..., list[Frame]]] = {"patches": patches, "trees": trees}


def smoothed(range_m: Image) -> Image:
    """Ranges with 1 / range the mean over pairs of neighbours in the row, which is straight on planes."""
    inverse = np.divide(1, range_m, out=np.zeros_like(range_m), where=range_m > 0)
    total, count = inverse.copy(), np.ones_like(range_m)
    for k in range(1, SMOOTH + 1):
        both = alike(range_m, k, SAME_RANGE) & alike(range_m, -k, SAME_RANGE)
        total += np.where(both, (beside(inverse, k) + beside(inverse, -k)) / 2, 0)
        count += both
    return np.divide(count, total, out=np.zeros_like(range_m), where=total > 0)


def patch_means(values: Image, range_m: Image) -> Image:
    """Means over what is one surface in the row. (Medians of skewed intensities would be off by row and range.)"""
    total, count = values.copy(), np.ones_like(values)
    for k in (*range(-PATCH, 0), *range(1, PATCH + 1)):
        same = alike(range_m, k, SAME_SURFACE)
        total += np.where(same, beside(values, k), 0)
        count += same
    return total / count


def mesh_error(shape: tuple[int, ...], rng: np.random.Generator) -> Image:
    """Smooth errors of a mesh, m."""
    from scipy.ndimage import gaussian_filter

    error = gaussian_filter(rng.normal(size=shape), MESH_CELLS)
    return MESH_M * error / error.std()


def rounded(intensity: Image) -> Image:
    """Intensities in 8 bits."""
    return np.clip(np.round(intensity * 255) / 255, 0, 1)


def features(scan: Scan, grid: Grid) -> Float[np.ndarray, "r c f"]:
    """What a tree is told of each ray: ln range, cosine, height, row, and steps of ln range to its neighbours."""
    hit = scan.range_m > 0
    log_range = np.log(np.where(hit, scan.range_m, 1.0))
    incidence = incidence_of(np.where(hit, scan.range_m, np.inf), grid)
    height = scan.range_m * np.sin(grid.elevation)[:, None]
    row = np.broadcast_to(np.arange(len(hit), dtype=float)[:, None], hit.shape)
    steps = [np.where(beside(hit, k), np.clip(beside(log_range, k) - log_range, -1, 1), 2.0) for k in (-2, -1, 1, 2)]
    return np.stack([log_range, np.cos(incidence), height, row, *steps], axis=-1)


def beside(values: np.ndarray, k: int) -> np.ndarray:
    """Of each cell the value k columns to the right (to the left below 0); 0 beyond the border."""
    out = np.zeros_like(values)
    if k > 0:
        out[:, :-k] = values[:, k:]
    else:
        out[:, -k:] = values[:, :k]
    return out


def alike(range_m: Image, k: int, share: float) -> Bool[np.ndarray, "r c"]:
    """Whether the neighbour k columns aside is of the same surface."""
    other = beside(range_m, k)
    return (range_m > 0) & (other > 0) & (np.abs(other - range_m) < share * range_m)
