"""Sparsifying the points of a 375 x 1242 depth map to 64 x 512 cells, against the published algorithm and numba.

    python benchmarks/speed/sparsify.py

The published algorithm is NumPy: angles by arcsin, assignment by fancy index, the last point wins. numba does the same
in one loop on both cores (angles) and one on one (winners). jaxsim is timed by the same rule, by `nearest`, and on the
beams of an HDL-64E, where each point looks for its beam among 64 that start at different heights.
"""

from __future__ import annotations

import math
import os

# Or numba's threads go on spinning into the next peer's turn.
os.environ["OMP_WAIT_POLICY"] = "PASSIVE"

import jax
import numba
import numpy as np
from timing import interleave

from jaxsim.cloud.pseudo_lidar import depth_to_cloud
from jaxsim.cloud.sparsify import PATTERNS, PUBLISHED_RANGE_M, crop_cloud, sparsify
from jaxsim.data.synthetic import kitti_camera
from jaxsim.frame import Cloud
from jaxsim.geometry import preset, window_grid

SHAPE = (64, 512)
STEP = np.float32(math.radians(0.4)), np.float32(math.radians(90 / 512))


def street(rng: np.random.Generator) -> np.ndarray:
    """A road, a wall 60 m ahead and boxes at random."""
    v = np.arange(375)[:, None] - 172.9
    depth = np.broadcast_to(np.where(v > 0, 721.5 * 1.65 / np.maximum(v, 1e-3), 60.0), (375, 1242)).clip(0, 60).copy()
    for _ in range(30):
        top, left = rng.integers(0, 250), rng.integers(0, 1100)
        np.minimum(
            depth[top : top + 120, left : left + 100], rng.uniform(5, 50), out=depth[top : top + 120, left : left + 100]
        )
    return depth.astype(np.float32)


def published(points: np.ndarray) -> np.ndarray:
    """Indices of the winners, rows first; -1 where there is none."""
    inside = np.ones(len(points), bool)
    for axis, (low, high) in enumerate(PUBLISHED_RANGE_M):
        inside &= (points[:, axis] >= low) & (points[:, axis] < high)
    kept = np.flatnonzero(inside)
    x, y, z = points[kept].T
    d, r = np.sqrt(x**2 + y**2 + z**2), np.sqrt(x**2 + y**2)
    column = ((np.float32(math.radians(45)) - np.arcsin(y / np.where(r == 0, np.float32(1e-6), r))) / STEP[1]).astype(
        int
    )
    row = ((np.float32(math.radians(2)) - np.arcsin(z / np.where(d == 0, np.float32(1e-6), d))) / STEP[0]).astype(int)
    cells = np.full(SHAPE, -1)
    cells[row.clip(0, SHAPE[0] - 1), column.clip(0, SHAPE[1] - 1)] = kept
    return cells.ravel()


@numba.njit(parallel=True)
def _cells(points, row_step, column_step):
    out = np.empty(len(points), np.int32)
    for i in numba.prange(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        out[i] = -1
        if 0 <= x < 120 and -50 <= y < 50 and -2.5 <= z < 1.5:
            square = x * x + y * y
            column = (np.float32(0.7853982) - math.asin(y / max(math.sqrt(square), np.float32(1e-6)))) / column_step
            row = (np.float32(0.034906585) - math.asin(z / max(math.sqrt(square + z * z), np.float32(1e-6)))) / row_step
            out[i] = min(max(int(row), 0), 63) * 512 + min(max(int(column), 0), 511)
    return out


@numba.njit
def _last(cells, count):
    winner = np.full(count, -1)
    for i in range(len(cells)):
        if cells[i] >= 0:
            winner[cells[i]] = i
    return winner


def in_numba(points: np.ndarray) -> np.ndarray:
    return _last(_cells(points, *STEP), SHAPE[0] * SHAPE[1])


def main() -> None:
    camera = kitti_camera()
    dense = jax.block_until_ready(depth_to_cloud(camera, street(np.random.default_rng(0)), np.ones((375, 1242), bool)))
    points = np.asarray(dense.xyz_m)[np.asarray(dense.valid)]
    cloud = jax.device_put(Cloud(points, np.zeros(len(points), np.float32), np.ones(len(points), bool)))
    even, _ = PATTERNS["64"]
    beams = window_grid(preset("hdl64e"), math.radians(45), math.radians(-45), columns=512)

    def last(cloud: Cloud) -> Cloud:
        return jax.block_until_ready(sparsify(crop_cloud(cloud), even, winner="last", clamp=True))

    ours = last(cloud)
    for name, run in (("published", published), ("numba", in_numba)):
        theirs = run(points)
        same = np.asarray(ours.valid) == (theirs >= 0)
        same &= (np.asarray(ours.xyz_m) == points[theirs]).all(axis=1) | ~np.asarray(ours.valid)
        print(f"{name} has the same point in {100 * same.mean():.3f} % of the cells")
    interleave(
        f"{len(points)} points to 64 x 512 cells",
        {
            "jaxsim, last wins": lambda: last(cloud),
            "published, NumPy": lambda: published(points),
            "numba": lambda: in_numba(points),
            "jaxsim, nearest wins": lambda: jax.block_until_ready(sparsify(crop_cloud(cloud), even)),
            "jaxsim, HDL-64E beams": lambda: jax.block_until_ready(sparsify(cloud, beams)),
        },
    )


if __name__ == "__main__":
    main()
