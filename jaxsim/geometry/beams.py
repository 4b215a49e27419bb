"""Beams and columns of a LiDAR that no table describes, told from the points of its own scans. Host code.

Letters: rho horizontal distance, z height, both from the sensor; e elevation of a beam and h height of its origin: a
beam's points lie on the cone z = h + rho tan e. c is an azimuth as a column that need not be whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.frame import PolarGrid
from jaxsim.geometry.polar import exact_column, spans_turn

ENOUGH_POINTS = 30
"""A ring with fewer points says nothing of its own beam."""
_ROUNDS = 12
_ORIGIN_WEIGHT = 1e-3  # one observation at 1 cm beside those at the file's 0.3 mm
_LEAST_MISS_M = 1e-4
_WORTH = 0.7
"""Origins above one another are believed where they leave less than this share of what one common origin leaves."""
_OFF_BEAMS, _OFF_ROWS = 0.1, 1.5
"""Share of points that may lie so many rows or more off their ring's beam: 0.01 to 0.04 in motion-compensated scans."""
_SAME_RAD = 1e-4
_LEAST_STEP_RAD = 2e-4
_TURN_GAP_RAD = np.deg2rad(30.0)
_LEAST_LINES, _CLEAR = 4, 2.0
"""Fewer beams are told by no gap; and how many times wider the narrowest gap between lines is than the widest in
one."""
_SLIP = 0.75
_RUN_STEPS, _STEP_ROUNDS = 20, 3
_LOST_STEPS, _ALIKE = 1.5, 0.05
_LOW_ORIGIN_M = 1.0


class NoBeams(ValueError):
    """The points do not lie on the beams of one LiDAR that looks from their origin."""


@dataclass(frozen=True)
class Beams:
    """A sensor's beams, top beam first, with the number that its log gives to each."""

    elevation_rad: Float[np.ndarray, " rows"]
    origin_m: Float[np.ndarray, " rows"]
    ring: Int[np.ndarray, " rows"]
    """Ring number of each row."""
    off_deg: float
    """Degrees by which points miss their beams, the median."""

    def rows_of(self, ring: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Row of each ring number; -1 where it is none of the sensor's."""
        order = np.argsort(self.ring)
        at = np.minimum(np.searchsorted(self.ring[order], ring), len(order) - 1)
        return np.where(self.ring[order][at] == ring, order[at], -1).astype(np.int32)


def fit_cones(
    rho: Float[np.ndarray, " n"],
    z: Float[np.ndarray, " n"],
    row: Int[np.ndarray, " n"],
    *,
    origin_m: Float[np.ndarray, " lines"],
    slope: Float[np.ndarray, " lines"],
    enough: Bool[np.ndarray, " lines"],
) -> tuple[Float[np.ndarray, " lines"], Float[np.ndarray, " lines"], Float[np.ndarray, " n"]]:
    """Origin and slope (tan e) of each line, and by how many metres each point misses its cone.

    Robust least squares (Cauchy weights) that starts at, and leans a little on, the given origins; lines that have not
    `enough` points keep what was given.
    """
    lines, prior_m = len(slope), origin_m
    weight = np.ones_like(z)

    def per_row(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " lines"]:
        return np.bincount(row, weight * values, lines)

    miss = np.zeros_like(z)
    for _ in range(_ROUNDS):
        # Normal equations of (h, tan e), with the prior's origin as one weak observation of h.
        hh = per_row(np.ones_like(z)) + _ORIGIN_WEIGHT
        ht = per_row(rho)
        tt = per_row(rho * rho)
        hz, tz = per_row(z) + _ORIGIN_WEIGHT * prior_m, per_row(rho * z)
        determinant = np.where(enough, np.maximum(hh * tt - ht * ht, 1e-9), 1.0)
        origin_m = np.where(enough, (hz * tt - tz * ht) / determinant, origin_m)
        slope = np.where(enough, (tz * hh - hz * ht) / determinant, slope)
        miss = z - origin_m[row] - rho * slope[row]
        scale = max(float(np.median(np.abs(miss))), _LEAST_MISS_M)
        # Cauchy's weight: what lies far off its cone, a stray or a wrong row, decides nothing.
        weight = 1 / (1 + (miss / scale) ** 2)
    return origin_m, slope, miss


def beams_of_rings(
    xyz_m: Float[np.ndarray, "n 3"], ring: Int[np.ndarray, " n"], *, rings: int | None = None, first: int = 0
) -> Beams:
    """The beams of a sensor whose points say which ring they are of; `rings` is how many there are, if it is known, and
    `first` the number of the first.

    A ring's beam is the median of its points' elevations; origins of their own are given to the beams where these leave
    clearly less. A ring with fewer than 30 points lies where its neighbours' numbers put it.

    Raises NoBeams where points lie off their rings' beams (the cloud is not in the sensor's frame, or was put together
    of several sensors), and where two rings look the same way.
    """
    if not len(ring) or ring.min() < first:
        raise NoBeams(
            f"rings are {ring.min(initial=0)}..{ring.max(initial=0)} in {len(ring)} points; they count from {first}"
        )
    highest = int(ring.max())
    ring = ring - first
    count = max(highest - first + 1, rings or 0)
    if count > 1024:
        raise NoBeams(f"ring numbers reach {highest}; no sensor has more than 1024 beams: is it another field?")
    rho = np.hypot(xyz_m[:, 0], xyz_m[:, 1]).astype(np.float64)
    z = xyz_m[:, 2].astype(np.float64)
    elevation = np.arctan2(z, rho)
    enough = np.bincount(ring, minlength=count) >= ENOUGH_POINTS
    if enough.sum() < 2:
        raise NoBeams(f"{int(enough.sum())} rings have {ENOUGH_POINTS} points or more; two are needed to tell a sensor")
    numbers = np.arange(count)
    middle = _medians(elevation, ring, count)
    middle = _between(numbers, middle, enough)
    origin = np.zeros(count)
    off = np.abs(elevation - middle[ring])
    usable = enough[ring] & (rho > 0.5)
    h, slope, miss = fit_cones(
        rho[usable], z[usable], ring[usable], origin_m=np.zeros(count), slope=np.tan(middle), enough=enough
    )
    angular = np.abs(miss) / np.maximum(np.hypot(rho[usable], z[usable]), 1e-3)
    if np.median(angular) < _WORTH * np.median(off[usable]) and np.abs(h).max() < _LOW_ORIGIN_M:
        middle = _between(numbers, np.arctan(slope), enough)
        origin = np.interp(numbers, numbers[enough], h[enough])
        off = np.abs(np.arctan2(z - origin[ring], rho) - middle[ring])
    if np.abs(middle).max() > np.pi / 2:
        raise NoBeams(
            f"ring numbers reach {highest}, and {int(enough.sum())} have {ENOUGH_POINTS} points or more; so many "
            "beams would look beyond the zenith: take those that the sensor has with --log.rings"
        )
    _check_on_beams(middle, off)
    order = np.argsort(-middle, kind="stable")
    close = np.flatnonzero(-np.diff(middle[order]) < _SAME_RAD)
    if len(close):
        a, b = order[close[0]], order[close[0] + 1]
        raise NoBeams(
            f"rings {a + first} and {b + first} look the same way ({np.rad2deg(middle[a]):.3f} degrees): a cloud of "
            "two sensors, or not in the sensor's frame"
        )
    return Beams(
        elevation_rad=middle[order],
        origin_m=origin[order],
        ring=order + first,
        off_deg=float(np.rad2deg(np.median(off))),
    )


def _medians(values: Float[np.ndarray, " n"], group: Int[np.ndarray, " n"], count: int) -> Float[np.ndarray, " count"]:
    order = np.lexsort((values, group))
    sizes = np.bincount(group, minlength=count)
    first = np.cumsum(sizes) - sizes
    at = np.minimum(first + sizes // 2, max(len(values) - 1, 0))
    return values[order][at]


def _between(
    numbers: Int[np.ndarray, " count"], values: Float[np.ndarray, " count"], known: Bool[np.ndarray, " count"]
) -> Float[np.ndarray, " count"]:
    """The values, with those that are not known between, or beyond, those of the neighbouring numbers."""
    if known.all():
        return values
    x, y = numbers[known], values[known]
    filled = np.interp(numbers, x, y)
    # Beyond the last known ring the beams go on at the median step: held constant, two would look the same way.
    step = float(np.median(np.diff(y) / np.diff(x)))
    filled = np.where(numbers < x[0], y[0] + step * (numbers - x[0]), filled)
    return np.where(numbers > x[-1], y[-1] + step * (numbers - x[-1]), filled)


def _check_on_beams(middle: Float[np.ndarray, " count"], off: Float[np.ndarray, " n"]) -> None:
    step = float(np.median(np.abs(np.diff(np.sort(middle)))))
    share = float((off > _OFF_ROWS * max(step, _SAME_RAD)).mean())
    if share > _OFF_BEAMS:
        raise NoBeams(
            f"{100 * share:.0f} % of the points lie {_OFF_ROWS:g} rows or more off the beam of their ring (rows are "
            f"{np.rad2deg(step):.2f} degrees apart): the points are not in the sensor's own frame, or the rings are "
            "not its beams"
        )


def rings_by_elevation(xyz_m: Float[np.ndarray, "n 3"], *, lines: int | None = None) -> Int[np.ndarray, " n"]:
    """Ring of each point, 0 the lowest, where no field says it: from gaps between the elevations of the beams.

    Every beam must look from the origin of the points, as those of simulators and of most sensors with one lens do.
    `lines` is how many beams there are, if it is known. Raises NoBeams where elevations do not fall into lines.
    """
    rho = np.hypot(xyz_m[:, 0], xyz_m[:, 1]).astype(np.float64)
    elevation = np.arctan2(xyz_m[:, 2].astype(np.float64), rho)
    far = rho > 2
    if far.sum() < 2 * ENOUGH_POINTS:
        raise NoBeams(f"{int(far.sum())} points lie 2 m or more away: too few to tell beams by")
    fine = np.sort(elevation[far])
    step = np.diff(fine)
    # Inside a line, elevations lie as close as rounding puts them; between lines there is a gap. The widest ratio
    # between two successive gaps of those that could part lines tells one kind from the other.
    gaps = np.sort(step)[::-1]
    most = min(len(gaps) - 1, 300 if lines is None else lines)
    ratio = gaps[:most] / np.maximum(gaps[1 : most + 1], 1e-9)
    cut = int(np.argmax(ratio[_LEAST_LINES - 2 :])) + _LEAST_LINES - 2 if lines is None else lines - 2
    least = float(gaps[cut])
    edges = (fine[1:] + fine[:-1])[step >= least] / 2
    full = np.bincount(np.searchsorted(edges, fine), minlength=cut + 2) >= ENOUGH_POINTS
    if ratio[cut] < _CLEAR or full.mean() < 0.5:
        raise NoBeams(
            "the points have no ring, and their elevations do not fall into lines (motion taken out, beams with "
            "origins of their own, or no spinning LiDAR): keep the ring when the cloud is written, or name the sensor"
        )
    return np.searchsorted(edges, elevation).astype(np.int32)


def column_azimuths(
    azimuth_rad: Float[np.ndarray, " n"], row: Int[np.ndarray, " n"], *, columns: int | None = None
) -> Float[np.ndarray, " columns"]:
    """Azimuths of a grid's columns for a scan: as many as a ring has firings, over the turn or the part that it sees.

    Raises NoBeams where no ring has neighbouring points.
    """
    step = _firing_step(azimuth_rad, row)
    seen = np.sort(azimuth_rad % (2 * np.pi))
    gap = np.diff(np.concatenate([seen, seen[:1] + 2 * np.pi]))
    widest = int(np.argmax(gap))
    if gap[widest] < _TURN_GAP_RAD:
        number = columns or max(round(2 * np.pi / step), 2)
        return np.pi - (np.arange(number) + 0.5) * (2 * np.pi / number)
    # The window begins left of the widest gap and ends right of it; azimuth falls from its left edge.
    right = seen[(widest + 1) % len(seen)]
    width = 2 * np.pi - gap[widest]
    left = right + width
    left -= 2 * np.pi * np.round((left + right) / 2 / (2 * np.pi))
    number = columns or max(round(width / step) + 1, 2)
    return left - np.arange(number) * (width / (number - 1))


def _firing_step(azimuth_rad: Float[np.ndarray, " n"], row: Int[np.ndarray, " n"]) -> float:
    """The mean azimuth from one firing to the next, over unbroken runs of firings.

    No median: an HDL-64E fires six times 0.18 degrees apart, then 0.09, and at the median's step two of its firings
    would share a column.
    """
    order = np.lexsort((azimuth_rad, row))
    step, same = np.diff(azimuth_rad[order]).astype(np.float64), np.diff(row[order]) == 0
    step = step[same & (step > _LEAST_STEP_RAD)]
    if len(step) < ENOUGH_POINTS:
        raise NoBeams(f"{len(step)} points have a neighbour on their ring: too few to tell how often the sensor fires")
    near = float(np.median(step))
    # Where more than half of the firings are lost the median gap is two steps; the most frequent one is one, always.
    often = _most_frequent(step)
    if near > _LOST_STEPS * often:
        near = often
    for _ in range(_STEP_ROUNDS):
        short = step[step < _RUN_STEPS * near]
        near = float(short.sum() / np.maximum(np.round(short / near), 1).sum())
    # A line through the firings of unbroken runs is nearer still.
    azimuth, ring = azimuth_rad[order].astype(np.float64), row[order]
    jump = np.diff(azimuth, prepend=azimuth[:1])
    run = np.cumsum((np.diff(ring, prepend=ring[:1]) != 0) | (jump > _RUN_STEPS * near))
    fired = np.maximum(np.round(jump / near), jump > _LEAST_STEP_RAD)
    firing = np.cumsum(np.where(np.diff(run, prepend=run[:1]) == 0, fired, 0))
    size = np.bincount(run)
    k = firing - (np.bincount(run, firing) / size)[run]
    a = azimuth - (np.bincount(run, azimuth) / size)[run]
    return float((k * a).sum() / max((k * k).sum(), 1.0)) or near


def _most_frequent(step: Float[np.ndarray, " n"]) -> float:
    """The step that is most frequent, within a twentieth of it."""
    bins = np.floor(np.log(step) / np.log1p(_ALIKE)).astype(int)
    count = np.bincount(bins - bins.min())
    # Steps about the border of two bins are in both.
    fullest = int(np.convolve(count, [1, 1])[:-1].argmax()) if len(count) > 1 else 0
    near = bins - bins.min()
    return float(np.median(step[(near == fullest) | (near == fullest - 1)]))


def assign_columns(
    azimuth_rad: Float[np.ndarray, " n"], row: Int[np.ndarray, " n"], grid: PolarGrid
) -> Int[np.ndarray, " n"]:
    """Column of each point, so that neighbouring firings of a ring fall into neighbouring columns.

    Beams fire at azimuths of their own, and a turn is no whole number of firings. Rounding each azimuth by itself would
    put two firings into one column and none into the next wherever a ring fires near the columns' edges. Here a ring's
    points keep their distance in columns, and slip by one where they would be more than 3/4 of a column off.
    Columns outside the grid are negative or too large.
    """
    grid = replace(grid, azimuth_rad=np.asarray(grid.azimuth_rad, np.float64))
    exact = exact_column(azimuth_rad.astype(np.float64), grid)
    order = np.lexsort((exact, row))
    c, ring = exact[order], row[order]
    starts = np.flatnonzero(np.diff(ring, prepend=ring[:1] - 1))
    ends = np.append(starts[1:], len(c))
    steps = np.cumsum(np.round(np.diff(c, prepend=c[:1])))
    result = np.empty(len(c), np.int64)
    for first, last in zip(starts, ends, strict=True):
        along = steps[first:last] - steps[first]
        drift = c[first:last] - along
        offset = round(float(np.median(drift)))
        if np.abs(drift - offset).max() > _SLIP:
            offset = _slips(drift)
        result[first:last] = along + offset
    if spans_turn(grid):
        result = np.clip(result, 0, len(grid.azimuth_rad) - 1)
    column = np.empty(len(c), np.int32)
    column[order] = result
    return column


def _slips(drift: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Whole columns that follow a drift, changed only where they would be more than _SLIP off."""
    offset = round(float(drift[0]))
    result = np.empty(len(drift), np.int64)
    for i, value in enumerate(drift.tolist()):
        if abs(value - offset) > _SLIP:
            offset = round(value)
        result[i] = offset
    return result
