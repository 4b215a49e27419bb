"""nuScenes LIDAR_TOP sweeps (`.pcd.bin`) of the HDL-32E as polar frames.

The file is float32 Nx5 (x right, y forward, z up, intensity 0..255, ring), ring 0 the lowest beam, one entry
for every firing: a beam that did not come back is stored as a point at the sensor itself.
"""

from __future__ import annotations

from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.data.sweep import Sweep
from jaxsim.frame import Cloud
from jaxsim.geometry import full_grid, points_to_polar, preset

Array = np.ndarray

_SENSOR = "hdl32e"
_CHANNEL = "__LIDAR_TOP__"
_COLUMNS = 900
"""A fifth fewer than the firings of a turn: motion compensation spreads them unevenly, and at the sensor's own
step that leaves 1.5 % of the cells empty which are no dropped returns."""


def read_lidar_top(path: Path | str, *, columns: int = _COLUMNS) -> Sweep:
    """One sweep, the car's forward direction in the middle; cells without return include rays that hit the car.

    Raises ValueError for a truncated file, non-finite points, a ring that is no beam, intensity off 0..255.
    """
    path = Path(path)
    points = _read(path)
    spec = preset(_SENSOR)
    x, y, z, intensity, ring = points.T
    cloud = Cloud(
        xyz_m=np.stack([y, -x, z], axis=1),
        intensity=intensity / np.float32(255),
        valid=np.linalg.norm(points[:, :3], axis=1) >= spec.min_range_m,
        row=(spec.rows - 1 - ring).astype(np.int32),
    )
    grid = full_grid(spec, columns)
    image, _ = points_to_polar(cloud, grid)
    name = path.name.removesuffix(".pcd.bin")
    scene, _, stamp = name.partition(_CHANNEL)
    return Sweep(
        name=name,
        scene=scene,
        image=jax.tree.map(np.asarray, image),
        grid=grid,
        time_s=int(stamp) / 1e6 if stamp.isdecimal() else None,
    )


def _read(path: Path) -> Float[Array, "n 5"]:
    if not path.is_file():
        raise ValueError(f"nuscenes: there is no {path}; pass a file samples/LIDAR_TOP/*.pcd.bin")
    size = path.stat().st_size
    if size == 0 or size % 20:
        raise ValueError(
            f"nuscenes: {path} has {size} bytes, no whole number of points (x y z intensity ring, float32, "
            "20 bytes each): truncated, or not a LIDAR_TOP file"
        )
    points = np.fromfile(path, "<f4").reshape(-1, 5)
    broken = int((~np.isfinite(points).all(axis=1)).sum())
    if broken:
        raise ValueError(f"nuscenes: {path}: {broken} of {len(points)} points are NaN or infinite; copy it again")
    ring, lines = points[:, 4], preset(_SENSOR).rows
    if (ring != np.round(ring)).any() or ring.min() < 0 or ring.max() >= lines:
        raise ValueError(
            f"nuscenes: {path}: the fifth value spans {ring.min():g}..{ring.max():g}; it must be the ring, a "
            f"whole number 0..{lines - 1}: not a LIDAR_TOP file"
        )
    low, high = points[:, 3].min(), points[:, 3].max()
    if low < 0 or high > 255 or 0 < high <= 1:
        raise ValueError(
            f"nuscenes: {path}: intensity spans {low:g}..{high:g}; nuScenes stores 0..255, so this file was "
            "rescaled: use the original"
        )
    return points
