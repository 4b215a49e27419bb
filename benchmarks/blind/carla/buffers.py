"""`raw_data` of CARLA's LiDARs and attributes.json beside it, byte by byte (LidarData.h, SemanticLidarData.h)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from benchmarks.blind.carla.street import Hits, directions

UPPER_DEG, LOWER_DEG = 10.0, -25.0
_PLAIN = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])
_SEMANTIC = np.dtype([*((name, "<f4") for name in ("x", "y", "z", "cos")), ("idx", "<u4"), ("tag", "<u4")])


def rays(channels: int, columns: int) -> np.ndarray:
    """Unit vectors of the sensor's rays."""
    return directions(channels, columns, upper_deg=UPPER_DEG, lower_deg=LOWER_DEG)


def write_attributes(folder: Path, kind: str, *, channels: int, columns: int) -> None:
    """`dict(lidar.attributes)` with the type, of what a script sets: all texts, and nothing that is hidden."""
    folder.mkdir(parents=True, exist_ok=True)
    attributes = {
        "type": f"sensor.lidar.{kind}",
        "channels": str(channels),
        "upper_fov": str(UPPER_DEG),
        "lower_fov": str(LOWER_DEG),
        "points_per_second": str(channels * columns * 10),
        "rotation_frequency": "10",
        "range": "120",
    }
    (folder / "attributes.json").write_text(json.dumps(attributes))


def write_plain(path: Path, ray: np.ndarray, range_m: np.ndarray, intensity: np.ndarray) -> None:
    """A buffer of ray_cast: the points that returned, channel by channel, y to the right."""
    there = range_m > 0
    points = np.zeros(int(there.sum()), _PLAIN)
    _place(points, ray[there] * range_m[there][:, None])
    points["intensity"] = intensity[there]
    path.write_bytes(points.tobytes())


def write_semantic(path: Path, ray: np.ndarray, seen: Hits) -> None:
    """A buffer of ray_cast_semantic: every ray that hits within 120 m."""
    there = (seen.distance_m > 0) & (seen.distance_m <= 120)
    points = np.zeros(int(there.sum()), _SEMANTIC)
    _place(points, ray[there] * seen.distance_m[there][:, None])
    points["cos"], points["idx"], points["tag"] = seen.cosine[there], seen.thing[there], seen.tag[there]
    path.write_bytes(points.tobytes())


def _place(points: np.ndarray, xyz: np.ndarray) -> None:
    for axis, name in enumerate("xyz"):
        points[name] = -xyz[:, axis] if name == "y" else xyz[:, axis]
