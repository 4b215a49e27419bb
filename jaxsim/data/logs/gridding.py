"""Scans onto one grid: the beams and columns of a sensor, told from its first scans, and every scan's points in
them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.calibration import check_rigid
from jaxsim.data.logs.scan import RING, LogOptions, LogScan, ring_of_shape
from jaxsim.data.sweeps import Sweep
from jaxsim.files import parse_settings, placed
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry import preset
from jaxsim.geometry.beams import Beams, NoBeams, assign_columns, beams_of_rings, column_azimuths, rings_by_elevation
from jaxsim.geometry.mount import fit_mount
from jaxsim.geometry.points import FAR_M
from jaxsim.geometry.rows import nearest_beams

_log = logging.getLogger(__name__)

FIRST = 5
"""Scans from which the sensor is told: a beam that looks into the sky has no return in one of them."""
LEAST_TURN_S, TURN_S = 5e-3, 10.0
"""Seconds that a turn takes, at least a tenth, at most two hundred times that of the fastest sensors, 20 Hz."""
_UNITS = {"microseconds": 1e3, "milliseconds": 1e6}
"""Units in which whole numbers are no nanoseconds, for which they are taken, and how much longer a turn then is."""
_DARK = 1 / 200
"""Share of full scale under which no log stays; bytes in 16 bits do, at 1 / 257."""
_MOUNT_M = (0.0, 0.0, 1.7)
"""Where a car's LiDAR stands, about."""
_SAME_FIRING_RAD = 2e-5
"""Points of one ring that lie closer in azimuth are returns of one firing: firings are 1e-3 rad apart."""
_STRANGE = 0.01
"""Share of points that may be of rings which the first scans did not have."""


@dataclass(frozen=True)
class ScanLayout:
    """What all scans of a log share."""

    beams: Beams
    grid: PolarGrid
    full_scale: float
    cloud_from_sensor: Float[np.ndarray, "4 4"]
    axis: int | None
    """Of organised clouds without rings: the axis along which they lie."""

    def to_json(self) -> dict[str, Any]:
        return {
            "ring": self.beams.ring.tolist(),
            "full_scale": self.full_scale,
            "cloud_from_sensor": self.cloud_from_sensor.tolist(),
            "axis": self.axis,
            "off_deg": self.beams.off_deg,
        }

    @classmethod
    def from_json(cls, content: Any, grid: PolarGrid, *, where: str) -> ScanLayout:
        """The layout of a folder that is gone on with, whose grid.json holds its grid. Raises ValueError, beginning
        with `where`, for what is none."""
        elevation, origin = np.asarray(grid.elevation_rad, np.float64), np.asarray(grid.origin_m, np.float64)
        with placed(f"{where}: what it says of the sensor cannot be read", TypeError, then=_ANEW):
            settings = parse_settings(_Kept, content)
        pose, ring = np.asarray(settings.cloud_from_sensor), np.asarray(settings.ring, np.int64)
        if not (
            len({*settings.ring}) == len(ring) == len(elevation)
            and settings.full_scale > 0
            and settings.axis in (None, 0, 1)
        ):
            raise ValueError(
                f"{where}: {len(ring)} rings, full scale {settings.full_scale:g} and axis {settings.axis} are no "
                f"sensor's of {len(elevation)} rows; {_ANEW}"
            )
        check_rigid(pose, f"{where}: cloud_from_sensor")
        return cls(Beams(elevation, origin, ring, settings.off_deg), grid, settings.full_scale, pose, settings.axis)


_Row = tuple[float, float, float, float]
_ANEW = "delete the folder, and the same command makes it anew"


@dataclass(frozen=True)
class _Kept:
    """What log.json holds of it."""

    ring: tuple[int, ...]
    full_scale: float
    cloud_from_sensor: tuple[_Row, _Row, _Row, _Row]
    axis: int | None
    off_deg: float


def infer_layout(scans: Sequence[LogScan], options: LogOptions, *, by: str) -> ScanLayout:
    """What the scans of a log share, from its first. Raises ValueError where the points do not tell it, saying what
    does."""
    scale = options.full_scale or _full_scale(scans)
    first, problem = scans[0], NoBeams("no ring")
    if not any(scan.came_back.any() for scan in scans):
        raise ValueError(f"{by}: no point of {first.name} came back; is the recording empty, or its field another?")
    for scan in scans:
        check_near(np.linalg.norm(scan.xyz_m[scan.came_back], axis=1), f"{by}: {scan.name}")
    # An organised cloud does not say which of its axes counts beams: the one along which elevations agree.
    for axis in (None,) if first.ring is not None or first.shape is None else (0, 1):
        try:
            return _layout(scans, options, scale=scale, axis=axis)
        except NoBeams as error:
            problem = error
    hint = (
        "give --log.mount fit where the points are in a car's frame, --log.rings 0-31 where they are of several "
        "sensors, --log.sensor hdl32e where the car's motion was taken out, or the log as the sensor's driver wrote it"
    )
    if first.ring is None and first.fields:
        names = f"{', '.join(RING[:-1])} or {RING[-1]}"
        hint += f"; its points have {', '.join(first.fields)}, and the ring's name would be {names}"
    raise ValueError(f"{by}: the sensor's beams cannot be told from {first.name}: {problem}; {hint}") from problem


def _layout(scans: Sequence[LogScan], options: LogOptions, *, scale: float, axis: int | None) -> ScanLayout:
    pose = np.eye(4)
    parts = [returned(scan, axis) for scan in scans]
    first = scans[0]
    spec = preset(options.sensor) if options.sensor and first.ring is None else first.spec
    if (options.mount or first.mount) == "fit":
        xyz = np.concatenate([p.xyz_m for p in parts])
        pose, _ = fit_mount(xyz, _all_rings(parts, options), near_m=_MOUNT_M)
        parts = [replace(p, xyz_m=in_frame(p.xyz_m, pose)) for p in parts]
    xyz = np.concatenate([p.xyz_m for p in parts])
    off = 0.0
    if spec is not None and first.ring is None:
        ring, missed_deg = nearest_beams(xyz, spec)
        off = float(np.median(missed_deg))
        axis = None  # a row is the beam that passes nearest, not the place in the array
    else:
        ring = _all_rings(parts, options)
    if spec is not None:
        origin = np.asarray(spec.origin_m, np.float64)
        beams = Beams(spec.elevation_rad, origin, np.arange(spec.rows), off)
        if first.ring is not None:
            row = beams.rows_of(ring)
            along = np.arctan2(xyz[:, 2] - origin[row], np.hypot(xyz[:, 0], xyz[:, 1]))
            missed = np.abs(along - spec.elevation_rad[row])[row >= 0]
            beams = replace(beams, off_deg=float(np.rad2deg(np.median(missed))))
    else:
        beams = beams_of_rings(xyz, ring, rings=options.lines, first=_first_ring(scans, options))
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0]).astype(np.float64)
    # Of one scan, the fullest: a recording often begins within a turn, and turns do not fire at the same azimuths.
    sizes = [len(p.xyz_m) for p in parts]
    fullest = int(np.argmax(sizes))
    one = slice(sum(sizes[:fullest]), sum(sizes[: fullest + 1]))
    azimuths = column_azimuths(azimuth[one], beams.rows_of(ring[one]), columns=options.columns or first.columns)
    grid = PolarGrid(
        azimuths.astype(np.float32), beams.elevation_rad.astype(np.float32), beams.origin_m.astype(np.float32)
    )
    return ScanLayout(beams, grid, scale, pose, axis)


def _all_rings(parts: Sequence[LogScan], options: LogOptions) -> Int[np.ndarray, " n"]:
    rings = [p.ring for p in parts if p.ring is not None]
    if len(rings) == len(parts):
        return np.concatenate(rings).astype(np.int64)
    return rings_by_elevation(np.concatenate([p.xyz_m for p in parts]), lines=options.lines).astype(np.int64)


def _first_ring(scans: Sequence[LogScan], options: LogOptions) -> int:
    """Where the log's rings count from: 1 where that is the lowest in all scans, of rays without return too."""
    rings = [scan.ring for scan in scans if scan.ring is not None and len(scan.ring)]
    lowest, highest = min((ring.min() for ring in rings), default=0), max((ring.max() for ring in rings), default=0)
    # Of more beams than there are numbers, one without return is the first.
    return int(lowest == 1 and (options.lines or 0) <= highest)


def _full_scale(scans: Sequence[LogScan]) -> float:
    """The format's own scale; else 1 or 255, whichever the scans stay under. Warns where they stay far under it."""
    largest = max(float(np.nanmax(scan.intensity, initial=0)) for scan in scans)
    scale = scans[0].full_scale or _usual_scale(largest, scans[0].name)
    if 0 < largest < _DARK * scale:
        likely = next((f"{usual:g}" for usual in (1, 255) if largest <= usual < scale), "and the sensor's own")
        _log.warning(
            f"frames: intensity reaches {largest:g} in the first scans, and {scale:g} is taken for full scale: frames "
            f"will be dark; if it is another, give --log.full-scale {likely}, with another --out"
        )
    return scale


def _usual_scale(largest: float, name: str) -> float:
    if largest > 255:
        raise ValueError(
            f"frames: intensity reaches {largest:g} in {name}, and the format does not say what is full "
            "scale; give it: --log.full-scale 65535, or the sensor's own"
        )
    # Drivers write shares or bytes; a dark scan in bytes still has one point above 1.
    return 1.0 if largest <= 1 else 255.0


def returned(scan: LogScan, axis: int | None = None) -> LogScan:
    """The scan without points that are none. Rings are told along `axis`."""
    ring = scan.ring
    if ring is None and axis is not None and scan.shape is not None:
        ring = ring_of_shape(scan.shape, axis)
    return replace(scan, ring=ring).only(scan.came_back)


def check_near(range_m: Float[np.ndarray, " n"], where: str) -> None:
    """Raises ValueError, beginning with `where`, for ranges that no LiDAR sees."""
    if range_m.max(initial=0) > FAR_M:
        raise ValueError(
            f"{where}: a point lies {range_m.max():g} off, and no LiDAR sees beyond {FAR_M:g} m; coordinates must be "
            "in metres (divide millimetres by 1000)"
        )


def in_frame(xyz_m: Float[np.ndarray, "n 3"], cloud_from_sensor: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "n 3"]:
    """Points of the cloud's frame in the sensor's."""
    # Map coordinates are thousands of kilometres: float32 keeps decimetres of them.
    moved = (xyz_m.astype(np.float64) - cloud_from_sensor[:3, 3]) @ cloud_from_sensor[:3, :3]
    return moved.astype(np.float32)


def to_sweep(scan: LogScan, layout: ScanLayout, options: LogOptions, *, by: str) -> Sweep:
    """A scan on the sensor's grid. Of several returns of a firing the one that is asked for is kept; of firings that
    share a cell, the nearest.

    Raises ValueError for ranges no LiDAR sees, intensity off the log's scale, and rings that the sensor does not have.
    """
    scan = returned(scan, layout.axis)
    where = f"{by}: {scan.name}"
    if not len(scan.xyz_m):
        raise ValueError(f"{where} holds no point; leave it out, or look at what recorded it")
    xyz = in_frame(scan.xyz_m, layout.cloud_from_sensor)
    if scan.ring is not None:
        row = layout.beams.rows_of(scan.ring)
        # A beam that saw nothing in the first scans may come later; many of them are another sensor.
        strange = float((row < 0).mean())
        if strange > _STRANGE:
            raise ValueError(
                f"{where}: {100 * strange:.0f} % of its points are of rings that the first scans did not have: another "
                "sensor's scan; give --log.lines if these are beams that saw nothing before"
            )
    else:
        row = nearest_beams(xyz, layout.grid)[0]
    inside = row >= 0
    span_s = 0.0 if scan.offset_s is None else float(scan.offset_s.max())
    if not span_s <= TURN_S:  # also where one is NaN
        raise ValueError(
            f"{where}: the times of its points span {span_s:g} s, and a turn takes at most {TURN_S:g}: whole numbers "
            "are nanoseconds, others seconds; write them so, or leave the field out"
        )
    scale = np.float32(layout.full_scale)
    low, high = float(scan.intensity.min()), float(scan.intensity.max())
    if low < 0 or high > scale:
        raise ValueError(
            f"{where}: intensity spans {low:g}..{high:g}, off the log's scale 0..{scale:g}; give --log.full-scale"
        )
    intensity = scan.intensity / scale
    origin = np.asarray(layout.grid.origin_m)[np.clip(row, 0, None)]
    # From the beam's own origin, as the grid has its rays.
    range_m = np.sqrt(xyz[:, 0] ** 2 + xyz[:, 1] ** 2 + (xyz[:, 2] - origin) ** 2)
    check_near(range_m, where)
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0])
    inside &= _one_return(azimuth, row, intensity=intensity, range_m=range_m, returns=options.returns)
    on_grid = np.flatnonzero(inside)
    column = assign_columns(azimuth[on_grid], row[on_grid], layout.grid)
    _check_turn(span_s, column, layout.grid, where=where)
    return _on_grid(scan, layout, on_grid, row=row[on_grid], column=column, range_m=range_m, intensity=intensity)


def _check_turn(span_s: float, column: Int[np.ndarray, " n"], grid: PolarGrid, *, where: str) -> None:
    """Raises ValueError where a turn at the speed of this part of one would be over sooner than any sensor's."""
    azimuths = np.asarray(grid.azimuth_rad, np.float64)
    seen_rad = len(np.unique(column)) * abs(azimuths[0] - azimuths[-1]) / (len(azimuths) - 1)
    turn_s = span_s * 2 * np.pi / max(seen_rad, 1e-9)
    # Where all times are the same, they are the scan's own.
    if not 0 < turn_s < LEAST_TURN_S:
        return
    likely = [unit for unit, longer in _UNITS.items() if LEAST_TURN_S <= turn_s * longer <= TURN_S]
    raise ValueError(
        f"{where}: the times of its points span {span_s:g} s, and a turn takes at least {LEAST_TURN_S:g}: whole "
        f"numbers are nanoseconds, others seconds{f' (whole {likely[0]} look so)' if likely else ''}; write them so, "
        "or leave the field out"
    )


def _one_return(
    azimuth: Float[np.ndarray, " n"],
    row: Int[np.ndarray, " n"],
    *,
    intensity: Float[np.ndarray, " n"],
    range_m: Float[np.ndarray, " n"],
    returns: str,
) -> np.ndarray:
    """Which points stay where a firing came back several times: its strongest or its last return."""
    # Returns of one firing share a beam and an azimuth, and need not follow one another in the log.
    order = np.lexsort((azimuth, row))
    apart = (np.diff(row[order]) != 0) | (np.diff(azimuth[order]) > _SAME_FIRING_RAD)
    if apart.all():
        return np.ones(len(row), bool)
    firing = np.empty(len(row), np.int64)
    firing[order] = np.concatenate([[0], np.cumsum(apart)])
    best = np.lexsort((intensity if returns == "strongest" else range_m, firing))
    last = np.append(np.diff(firing[best]) != 0, True)
    stays = np.zeros(len(row), bool)
    stays[best[last]] = True
    return stays


def _on_grid(
    scan: LogScan,
    layout: ScanLayout,
    point: Int[np.ndarray, " m"],
    *,
    row: Int[np.ndarray, " m"],
    column: Int[np.ndarray, " m"],
    range_m: Float[np.ndarray, " n"],
    intensity: Float[np.ndarray, " n"],
) -> Sweep:
    rows, columns = len(layout.grid.elevation_rad), len(layout.grid.azimuth_rad)
    within = (column >= 0) & (column < columns)
    point, cell = point[within], row[within].astype(np.int64) * columns + column[within]
    # The last write to a cell stays: the nearest.
    order = np.argsort(-range_m[point], kind="stable")
    winner = np.full(rows * columns, -1, np.int64)
    winner[cell[order]] = point[order]
    valid = (winner >= 0).reshape(rows, columns)
    index = np.maximum(winner, 0).reshape(rows, columns)

    def raster(values: np.ndarray) -> np.ndarray:
        return np.where(valid, values[index], values.dtype.type(0))

    rasters = {key: raster(value) for key, value in scan.layers.items()}
    if scan.offset_s is not None:
        rasters["time"] = raster(scan.offset_s.astype(np.float32))
    return Sweep(
        name=scan.name,
        scene=scan.scene,
        image=PolarImage(raster(range_m.astype(np.float32)), raster(intensity.astype(np.float32)), valid),
        grid=layout.grid,
        time_s=scan.time_s,
        rasters=rasters,
        hidden=1 - float(valid.sum()) / max(len(point), 1),
    )
