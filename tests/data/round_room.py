"""Scans and images in KITTI's formats of a round room, whose geometry is known by hand."""

from pathlib import Path

import cv2
import numpy as np

from jaxsim.geometry import preset


def scan(columns: int = 1440) -> np.ndarray:
    """A whole turn inside a round room, line by line from straight ahead to the left, as KITTI stores it."""
    spec = preset("hdl64e")
    azimuth = np.deg2rad((np.arange(columns) + 0.5) * 360 / columns)
    elevation = spec.elevation_rad[:, None]
    height = np.asarray(spec.origin_m)[:, None]
    rho = np.minimum(20.0, np.where(elevation < 0, (1.73 + height) / np.tan(-np.minimum(elevation, -1e-3)), 20.0))
    z = height + rho * np.tan(elevation)
    points = np.stack([rho * np.cos(azimuth), rho * np.sin(azimuth), z + 0 * azimuth], axis=-1)
    line = np.arange(spec.rows)[:, None] / 100 + 0 * azimuth
    return np.concatenate([points, line[..., None]], axis=-1).reshape(-1, 4).astype("<f4")


def write_image(path: Path, size: tuple[int, int] = (375, 1242)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    image = np.zeros((*size, 3), np.uint8)
    image[:, : size[1] // 2] = (10, 20, 30)  # blue, green, red
    assert cv2.imwrite(str(path), image)


def write_scan(path: Path, points: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    points.astype("<f4").tofile(path)
