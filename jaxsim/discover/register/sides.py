"""Both sides of a registration: simulated planes, and a choice of measured points that are held against them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxsim.effects.rays import Scan

POINTS = 60_000
"""Points looked at in all frames together ..."""
FEWEST_POINTS, MOST_POINTS = 300, 4000
"""... and of each frame, at least and at most."""
POSE = slice(0, 6)
"""The pose among a motion's numbers: x, y, z in m and a rotation vector in rad;"""
LIFT = 6
"""how much higher beams point, rad;"""
TRAVEL = 7
"""and the way driven forward during the scan, m."""
NUMBERS = 8
Motion = Float[np.ndarray, "*f 8"]
Points = Float[np.ndarray, "f n 3"]


@dataclass(frozen=True)
class Sides:
    """The simulated images, and n measured points of each frame."""

    azimuth_rad: Float[np.ndarray, " c"]
    elevation_rad: Float[np.ndarray, " r"]
    origin_m: Float[np.ndarray, " r"]
    full: bool
    """Whether the image closes."""
    planes_m: Float[np.ndarray, "f r c"]
    """Simulated ranges; 0 where nothing is hit."""
    slopes: Float[np.ndarray, "f r c 2"]
    row: Int[np.ndarray, "f n"]
    range_m: Float[np.ndarray, "f n"]
    direction: Points
    upward: Points
    """Change of the direction with the elevation."""
    late: Float[np.ndarray, "f n"]
    """Place within the scan, from its middle, -1/2..1/2."""
    counts: Bool[np.ndarray, "f n"]
    """Frames with fewer returns have fewer points."""

    def thinned(self, every: int) -> Sides:
        """The same sides with some of the points alone."""
        of_points = ("row", "range_m", "direction", "upward", "late", "counts")
        return replace(self, **{name: getattr(self, name)[:, ::every] for name in of_points})


@dataclass(frozen=True)
class Met:
    """The planes that points are held against."""

    normal: Points
    away_m: Float[np.ndarray, "f n"]
    """Distance of the plane from the origin."""
    inside: Bool[np.ndarray, "f n"]
    """Whether there is one."""


def sides_of(scan: Scan, range_m: Float[np.ndarray, "f r c"], valid: Bool[np.ndarray, "f r c"]) -> Sides:
    """A simulated scan, and points of the measured ranges, drawn evenly."""
    grid = scan.grid
    count = int(np.clip(POINTS // len(range_m), FEWEST_POINTS, MOST_POINTS))
    azimuth = np.asarray(grid.azimuth_rad, float)
    elevation = np.asarray(grid.elevation_rad, float)
    rng = np.random.default_rng(0)
    # Frames of fewer points are filled up with ones that do not count.
    cell = np.zeros((len(range_m), count), int)
    counts = np.zeros(cell.shape, bool)
    for k, known in enumerate(valid & (range_m > 0)):
        at = rng.permutation(np.flatnonzero(known))[:count]
        cell[k, : len(at)] = at
        counts[k, : len(at)] = True
    row, column = np.unravel_index(cell, range_m.shape[1:])
    frame = np.arange(len(cell))[:, None]
    a = azimuth[column]
    e = elevation[row]
    # An image closes where one more column would stand on the first.
    step = abs(azimuth[1] - azimuth[0])
    return Sides(
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        origin_m=np.asarray(grid.origin_m, float),
        full=bool(abs(azimuth[0] - azimuth[-1]) + step > 2 * np.pi - step / 2),
        planes_m=np.where(scan.hit, scan.range_m, 0).astype(float),
        slopes=np.asarray(scan.slopes, float),
        row=row,
        range_m=np.where(counts, range_m[frame, row, column], 1).astype(float),
        direction=np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1),
        upward=np.stack([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)], axis=-1),
        late=np.asarray(scan.phase, float)[frame, row, column] - 0.5,
        counts=counts,
    )


def origin_of(sides: Sides, motion: Motion) -> Points:
    """Gives where the sensor was as each point was measured, m."""
    driven = motion[:, TRAVEL, None] * sides.late
    return motion[:, None, :3] + np.stack([driven, 0 * driven, 0 * driven], axis=-1)


def turned(sides: Sides, motion: Motion) -> tuple[Points, Points]:
    """The points from the origin of their beam as the simulator has its axes, and their change with beams' lift."""
    lift = motion[:, LIFT, None, None]
    ahead = np.cos(lift) * sides.direction + np.sin(lift) * sides.upward
    upward = np.cos(lift) * sides.upward - np.sin(lift) * sides.direction
    frames = len(sides.range_m)
    matrix = np.broadcast_to(Rotation.from_rotvec(motion[:, 3:6]).as_matrix(), (frames, 3, 3))
    far = sides.range_m[..., None]
    return (far * ahead) @ np.swapaxes(matrix, 1, 2), (far * upward) @ np.swapaxes(matrix, 1, 2)


def meet(sides: Sides, place: Points) -> Met:
    """The planes of the cells in whose direction points lie, from their beams' own origins."""
    x, y, z = np.moveaxis(place, -1, 0)
    rows = len(sides.elevation_rad)
    columns = len(sides.azimuth_rad)
    down = np.interp(-np.arctan2(z, np.hypot(x, y)), -sides.elevation_rad, np.arange(rows), left=-1, right=rows)
    step = (sides.azimuth_rad[0] - sides.azimuth_rad[-1]) / (columns - 1)
    off = np.arctan2(y, x) - (sides.azimuth_rad[0] + sides.azimuth_rad[-1]) / 2
    # From the middle of the image: an arc that crosses the back has no jump in it.
    off -= 2 * np.pi * np.round(off / (2 * np.pi))
    column = np.round((columns - 1) / 2 - off / step).astype(int)
    row = np.round(down).astype(int)
    inside = sides.counts & (row >= 0) & (row < rows) & (sides.full | ((column >= 0) & (column < columns)))
    row = np.clip(row, 0, rows - 1)
    column = column % columns if sides.full else np.clip(column, 0, columns - 1)
    at = (np.arange(len(place))[:, None], row, column)
    a = sides.azimuth_rad[column]
    e = sides.elevation_rad[row]
    u, v = np.moveaxis(sides.slopes[at], -1, 0)
    # The cell's ray, its left and its up, in which slopes are written.
    ahead = np.cos(e) - v * np.sin(e)
    normal = np.stack(
        [ahead * np.cos(a) - u * np.sin(a), ahead * np.sin(a) + u * np.cos(a), np.sin(e) + v * np.cos(e)], axis=-1
    )
    length = np.sqrt(1 + u * u + v * v)
    normal = normal / length[..., None]
    # Planes are written from the origin of the cell's beam, points from that of their own.
    away = sides.planes_m[at] / length + normal[..., 2] * (sides.origin_m[row] - sides.origin_m[sides.row])
    return Met(normal, away, inside & (sides.planes_m[at] > 0))


def predicted(sides: Sides, motion: Motion) -> Float[np.ndarray, "f n"]:
    """The simulated range of every point's ray at the frames' motions, m; NaN where it meets nothing."""
    ray, _ = turned(sides, motion)
    origin = origin_of(sides, motion)
    met = meet(sides, ray + origin)
    towards = np.sum(met.normal * ray, -1) / sides.range_m
    away = met.away_m - np.sum(met.normal * origin, -1)
    # A plane that lies behind the ray, or that it sees from behind, predicts nothing.
    known = met.inside & (towards > 0) & (away > 0)
    return np.where(known, away / np.where(known, towards, 1), np.nan)
