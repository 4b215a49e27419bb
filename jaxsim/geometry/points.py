"""Points of a LiDAR's cloud: what they can be, whoever read them; and turned about the sensor's axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Shaped

FAR_M = 1000.0
"""No car's LiDAR sees farther: what lies beyond is in millimetres or centimetres."""
NEAR_M = 1e-3
"""No LiDAR sees anything so near: text and whole numbers that are read as coordinates are all smaller, and zeros."""

PAGE_BYTES = 4096
"""What a disk reserves at once for a file: so many zeros, one after another, were never written."""


def check_points(points: Float[np.ndarray, "n c"], where: str) -> None:
    """Checks rows of x, y, z (m) and, where there is a fourth column, intensity (0..1); `where` begins the errors.

    Raises ValueError for a cloud without points, points that are not finite, ones that no LiDAR sees, a cloud that is
    nothing but the sensor's own place, and intensity that is off its scale.
    """
    if points.ndim != 2 or points.shape[1] not in (3, 4):
        raise ValueError(f"{where}: a cloud of shape {points.shape}; it must be rows of x, y, z and intensity")
    if not len(points):
        raise ValueError(f"{where}: the cloud holds no points; leave the frame out, or look at what made it")
    broken = int((~np.isfinite(points).all(axis=1)).sum())
    if broken:
        raise ValueError(
            f"{where}: {broken} of {len(points)} points are NaN or infinite; a ray without return is no point: leave "
            "these out"
        )
    far = float(np.abs(points[:, :3]).max())
    if far > FAR_M:
        raise ValueError(
            f"{where}: a point lies {far:g} off along an axis, and no LiDAR sees beyond {FAR_M:g} m; coordinates must "
            "be in metres (divide millimetres by 1000)"
        )
    if far < NEAR_M:
        raise ValueError(
            f"{where}: all {len(points)} points lie within {NEAR_M:g} m of the sensor, where no LiDAR sees anything: "
            "the file is of another kind (text, labels), or its content was lost; copy it again"
        )
    if points.shape[1] == 4:
        low, high = float(points[:, 3].min()), float(points[:, 3].max())
        if low < 0 or high > 1:
            raise ValueError(
                f"{where}: intensity spans {low:g}..{high:g}; it must lie in 0..1, so this is another sensor's file or "
                "one that was rescaled (divide 0..255 by 255)"
            )


def check_end(fields: Sequence[Shaped[np.ndarray, " n"]], *, record_bytes: int) -> None:
    """Checks the records of a file, by field, in a format where zeros may be rays without return.

    Raises ValueError where at its end a page or more of records of `record_bytes` is nothing but zeros, and no other
    record is: their place was reserved, and they were never written.
    """
    filled = np.zeros(len(fields[0]), bool)
    for field in fields:
        if field.dtype.kind in "biuf":
            filled |= field != 0
    written = np.flatnonzero(filled)
    last = int(written[-1]) + 1 if len(written) else 0
    if len(written) == last and (len(filled) - last) * record_bytes >= PAGE_BYTES:
        raise ValueError(f"its points from number {last} of {len(filled)} on are zeros alone: they were never written")


def turned_points(xyz_m: Float[np.ndarray, "n 3"], angle_rad: float) -> Float[np.ndarray, "n 3"]:
    """Points of `velo` turned about its vertical axis, counter-clockwise seen from above."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], np.float32)
    return (xyz_m @ rotation.T).astype(np.float32)
