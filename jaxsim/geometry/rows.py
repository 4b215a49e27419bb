"""Laser lines of a cloud that lies line by line in its file, as KITTI's do. Host code: a file's order is no kernel.

Inside a line the azimuth grows from straight ahead to the left and all the way round. So the lines' seam lies
in the middle of the forward view, and each line of a cloud cropped to the camera has a piece on either side
of it. Elevation alone tells the line only where the beam table is known and the car's motion was not taken
out: of a compensated scan it gets 58 % right.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.frame import PolarGrid
from jaxsim.geometry.beams import ENOUGH_POINTS, fit_cones
from jaxsim.geometry.sensor import PRESETS, LidarSpec

_JUMP_DEG = 20.0
"""A line ends where the azimuth falls by more. Inside compensated lines it falls by up to 6 degrees, and the
last point of a line without returns ahead lies 320 degrees after the first of the next."""
_SEAM_POINTS = 8
"""At most so many points of a line flicker back across the seam, and that soon after its start."""
_SAME_LINE_DEG = 0.15
"""Neighbours in azimuth that lie closer in elevation are of one line: half the least step between beams."""
_SPREAD_DEG = 6.0
"""Elevations of one line spread by less: by 3 degrees in a narrow street, since a beam starts up to 0.2 m
above the origin from which they are seen here."""
_FITS_DEG = 0.05
_ON_BEAM_DEG, _ALL_ON_BEAMS = 0.06, 0.98
"""Points of an uncompensated scan miss the nominal beams by less: 0.02 degrees in KITTI's, and the file's 1 mm grid
adds 0.03 at 2 m. In KITTI's compensated scans 28 to 53 % do."""
_AGREE = 0.999
"""Share of an uncompensated scan's points whose order and beam say the same line: all but one or two of 120 000."""
_FALLS = 0.1
"""Share of steps backwards in azimuth: 0.008 in compensated scans, 0.0002 in others."""
_OFF_BEAMS = 0.1
"""Share of a compensated scan's points two beams or more from their line's: 0.01 to 0.04 in KITTI's odometry."""
_WIDE_MISS = 4  # beams: a point further off counts as that far, so that strays do not decide where a line belongs
_NEW_LINE_COST = 10  # points x beams that must speak for a new line where the azimuth runs on


class UnorderedCloud(ValueError):
    """The order of the points does not tell their laser lines."""


def recover_rows(
    xyz: Float[np.ndarray, "n 3"], lines: int = 64, *, spec: LidarSpec | None = None
) -> Int[np.ndarray, " n"]:
    """Laser line of every point, 0 = top, from their order: a line starts where the azimuth jumps back.

    Where lines are missing, the last one found is the sensor's last (the sky swallows the top ones first).
    That is wrong for clouds that lost lines elsewhere, as those cropped to a camera do: give `spec`, and the
    lines found, in their order, take the beams that their elevations fit best. Its `rows` must be `lines`.

    With `spec` the answer is held against its beams. Where the points lie on them, as those of an uncompensated scan do
    to a few hundredths of a degree, and their order says another thing, as in a scan that was written clockwise,
    mirrored or from behind the car, the beams are right. Where they do not lie on them, because motion was taken out,
    lines must run counter-clockwise, and the table must not speak against them.

    The published rule (scan unfolding; Triess et al. 2020, r2dm) starts a line where the azimuth's quadrant
    goes from 4 to 1. This one gives the same on whole scans, but takes no flicker at the seam for a line and
    loses none that has no point in a quadrant.

    Raises UnorderedCloud where more lines are found than the sensor has, or where they are not lines: their
    elevations spread, or do not fall, their azimuth falls, or points lie two beams or more from their line's. Raises
    ValueError for points that are not finite.
    """
    if spec is not None and spec.rows != lines:
        raise ValueError(f"recover_rows: lines is {lines}, but {spec.name} has {spec.rows}; they must be equal")
    if len(xyz) == 0:
        return np.zeros(0, np.int32)
    if not np.isfinite(xyz).all():
        bad = int((~np.isfinite(xyz).all(axis=1)).sum())
        raise ValueError(f"recover_rows: {bad} of {len(xyz)} points are not finite; remove them first")
    elevation = np.rad2deg(np.arctan2(xyz[:, 2].astype(np.float64), np.hypot(xyz[:, 0], xyz[:, 1])))
    azimuth = np.rad2deg(np.arctan2(xyz[:, 1].astype(np.float64), xyz[:, 0])) % 360
    starts = _line_starts(azimuth, elevation)
    line = np.cumsum(starts, dtype=np.int32) - 1
    count = int(line[-1]) + 1
    if count > lines:
        raise UnorderedCloud(
            f"{count} laser lines found in {len(xyz)} points, but the sensor has {lines}: the points are not in "
            "the order of the lines (shuffled, merged, or sorted by time), or `lines` is too small"
        )
    _check_elevations(elevation, line)
    in_order = line + np.int32(lines - count)
    if spec is None:
        _check_direction(azimuth)
        return in_order
    nearest, miss_deg = nearest_beams(xyz, spec)
    row = in_order if count == lines else _rows_by_beams(azimuth, starts, nearest, spec=spec)
    if (miss_deg < _ON_BEAM_DEG).mean() > _ALL_ON_BEAMS:
        return row if (row == nearest).mean() > _AGREE else nearest
    _check_direction(azimuth)
    _check_beams(row, nearest, spec)
    return row


def _check_direction(azimuth: Float[np.ndarray, " n"]) -> None:
    step = np.diff(azimuth)
    near = np.abs(step) < _JUMP_DEG
    falls = float((step[near] < 0).mean()) if near.any() else 0.0
    if falls > _FALLS:
        raise UnorderedCloud(
            f"azimuth falls in {100 * falls:.0f} % of the steps from point to point: lines must run counter-clockwise, "
            "from straight ahead to the left (clockwise, mirrored or shuffled?)"
        )


def _check_beams(row: Int[np.ndarray, " n"], nearest: Int[np.ndarray, " n"], spec: LidarSpec) -> None:
    off = float((np.abs(row - nearest) > 1).mean())
    if off > _OFF_BEAMS:
        raise UnorderedCloud(
            f"{100 * off:.0f} % of the points lie two beams of {spec.name} or more from the laser line that their "
            "order gives them: the points are in another order than line by line from straight "
            "ahead to the left, or another sensor's"
        )


def _line_starts(azimuth: Float[np.ndarray, " n"], elevation: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    step = np.diff(azimuth)
    starts = np.zeros(len(azimuth), bool)
    starts[0] = True
    start, back = 0, -1
    # A jump back, or one of nearly a turn forward: a point right of the seam among those left of it.
    for i in np.flatnonzero((step < -_JUMP_DEG) | (step > 360 - 2 * _JUMP_DEG)) + 1:
        if step[i - 1] > 0:
            back = i if i - start <= _SEAM_POINTS else -1
            continue
        if back >= 0 and i - back <= _SEAM_POINTS:
            # Forward over the seam, back, and forward again: one of the two starts a line, or both a short one.
            here = np.median(elevation[start:back])
            if abs(here - np.median(elevation[i : i + 3])) < _SAME_LINE_DEG:
                back = -1
                continue
            if start > 0 and abs(here - np.median(elevation[max(start - 3, 0) : start])) < _SAME_LINE_DEG:
                starts[start] = False
        starts[i] = True
        start, back = i, -1
    return starts


def _check_elevations(elevation: Float[np.ndarray, " n"], line: Int[np.ndarray, " n"]) -> None:
    groups = np.split(elevation, np.flatnonzero(np.diff(line)) + 1)
    middle = np.array([np.median(group) for group in groups])
    spread = np.median([np.subtract(*np.percentile(group, (90, 10))) for group in groups])
    falling = (np.diff(middle) < 0).mean() if len(groups) > 1 else 1.0
    if spread > _SPREAD_DEG:
        raise UnorderedCloud(
            f"the {len(groups)} runs of growing azimuth in {len(line)} points spread over {spread:.1f} degrees of "
            "elevation each: they are no laser lines (points in the order of time, not line by line?)"
        )
    if falling < 0.75:
        raise UnorderedCloud(
            f"elevation falls in only {100 * falling:.0f} % of the steps from one laser line to the next; the file "
            "must hold the top line first"
        )


def _rows_by_beams(
    azimuth: Float[np.ndarray, " n"], starts: Bool[np.ndarray, " n"], nearest: Int[np.ndarray, " n"], *, spec: LidarSpec
) -> Int[np.ndarray, " n"]:
    """Cheapest rows of the pieces between jumps, growing at every start of a line and never falling.

    At jumps forward, too, a line may end: where one has no points to the right and the next none to the left.
    """
    jumps = starts | (np.diff(azimuth, prepend=0) > _JUMP_DEG)
    piece = np.cumsum(jumps) - 1
    # Whether a piece begins with a jump back, where a new line must start.
    firm = starts[np.searchsorted(piece, np.arange(piece[-1] + 1))]
    votes = np.zeros((len(firm), spec.rows))
    np.add.at(votes, (piece, nearest), 1)
    rows = np.arange(spec.rows)
    # Cost of a piece in each row: how many beams its points lie off, summed.
    misses = votes @ np.minimum(np.abs(rows[:, None] - rows), _WIDE_MISS)

    # Dynamic programming over the pieces: the least cost so far with the last piece in each row, and whence.
    total, came_from = misses[0], []
    for cost, new_line in zip(misses[1:], firm[1:], strict=True):
        best = np.minimum.accumulate(total)
        above = np.maximum.accumulate(np.where(total == best, rows, 0))
        # A new line lies below the one before: its row is reached from any row above.
        onward = np.concatenate([[np.inf], best[:-1]])
        source = np.concatenate([[0], above[:-1]])
        if not new_line:
            stays = total <= onward + _NEW_LINE_COST
            onward, source = np.where(stays, total, onward + _NEW_LINE_COST), np.where(stays, rows, source)
        came_from.append(source)
        total = cost + onward
    path = [int(np.argmin(total))]
    for source in reversed(came_from):
        path.append(int(source[path[-1]]))
    if total.min() > len(nearest) * _WIDE_MISS / 2:
        raise UnorderedCloud(
            f"the {int(starts.sum())} laser lines found lie {total.min() / len(nearest):.1f} or more beams off those "
            f"of {spec.name} on average: is it that sensor, in its own frame?"
        )
    return np.asarray(path[::-1], np.int32)[piece]


def rows_by_elevation(xyz: Float[np.ndarray, "n 3"], spec: LidarSpec) -> Int[np.ndarray, " n"]:
    """The beam that passes nearest in angle, each seen from its own origin: for clouds without order."""
    return nearest_beams(xyz, spec)[0]


def nearest_beams(
    xyz: Float[np.ndarray, "n 3"], beams: LidarSpec | PolarGrid
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """The beam that passes nearest in angle, each seen from its own origin, and by how many degrees it misses."""
    rho = np.hypot(xyz[:, 0], xyz[:, 1]).astype(np.float64)
    z = xyz[:, 2].astype(np.float64)
    row, best = np.zeros(len(xyz), np.int32), np.full(len(xyz), np.inf)
    elevations, origins = np.asarray(beams.elevation_rad), np.asarray(beams.origin_m)
    for i, (elevation, origin) in enumerate(zip(elevations, origins, strict=True)):
        angle = np.abs(np.arctan2(z - origin, rho) - elevation)
        nearer = angle < best
        row[nearer], best[nearer] = i, angle[nearer]
    return row, np.rad2deg(best)


def fit_beams(
    xyz: Float[np.ndarray, "n 3"], row: Int[np.ndarray, " n"], lines: int = 64, *, name: str = "fitted"
) -> LidarSpec:
    """This unit's own beam table, from a scan whose lines are known: z = h + rho tan e is a straight line a beam.

    Robust least squares (Cauchy weights). A beam with fewer than 30 points keeps the value of the
    first preset with so many lines; one whose points are all equally far leans on its origin. Of
    an uncompensated KITTI scan the residual is the file's 1 mm grid and nothing else.

    Raises ValueError where the points do not lie on cones: wrong rows, or the car's motion was taken out.
    """
    prior = next((spec for spec in PRESETS.values() if spec.rows == lines), None)
    if prior is None:
        raise ValueError(
            f"fit_beams: no preset with {lines} lines to start from; "
            f"there are {', '.join(f'{spec.name} {spec.rows}' for spec in PRESETS.values())}"
        )
    if row.min(initial=0) < 0 or row.max(initial=0) >= lines:
        raise ValueError(f"fit_beams: rows are {row.min()}..{row.max()}, but the sensor has lines 0..{lines - 1}")
    rho, z = np.hypot(xyz[:, 0], xyz[:, 1]).astype(np.float64), xyz[:, 2].astype(np.float64)
    enough = np.bincount(row, minlength=lines) >= ENOUGH_POINTS
    origin, slope, miss = fit_cones(
        rho, z, row, origin_m=np.asarray(prior.origin_m, np.float64), slope=np.tan(prior.elevation_rad), enough=enough
    )
    off_deg = np.rad2deg(np.median(np.abs(miss) / np.maximum(rho, 1e-3))) if len(z) else 0.0
    if off_deg > _FITS_DEG:
        raise ValueError(
            f"fit_beams: points lie {off_deg:.2f} degrees off their beams (median): the rows are wrong, or the car's "
            "motion was taken out of this scan; fit an uncompensated one, or use a preset"
        )
    elevation = np.where(enough, np.rad2deg(np.arctan(slope)), np.asarray(prior.elevation_deg))
    return replace(
        prior,
        name=name,
        elevation_deg=tuple(float(e) for e in elevation.round(5)),
        origin_m=tuple(float(h) for h in origin.round(6)),
    )
