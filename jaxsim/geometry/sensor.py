"""LiDARs as tables: where each beam starts and points, how often it fires, how far it sees; and grids of their rays.

Letters: e elevation of a beam, seen from its own origin; h height of that origin above the origin of `velo`.
A beam that hits something at horizontal distance rho hits it at z = h + rho tan(e).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float

from jaxsim.config.ranges import Checked, Count, NotNegative, Positive
from jaxsim.frame import PolarGrid

SAME_WITHIN = 1e-4
"""Grids are one where rays differ by no more, in rad and, of their origins, in m: a centimetre at 100 m, a tenth of
the finest sensor's steps, and far above the rounding of angles that other programs wrote with six digits."""


@dataclass(frozen=True)
class LidarSpec(Checked):
    """One spinning LiDAR. Hashable, so that it can be a static argument of a jitted function."""

    name: str
    elevation_deg: tuple[Annotated[float, Ge(-90), Le(90)], ...]
    """Elevation of each beam, seen from its own origin; top beam first."""
    origin_m: tuple[Annotated[float, Ge(-10), Le(10)], ...]
    """Height of each beam's origin above the origin of `velo`."""
    columns: Count
    """Firings of a beam in a full turn."""
    min_range_m: NotNegative
    max_range_m: Positive
    range_step_m: NotNegative = 0.0
    """Quantization of the range; 0 none."""
    intensity_step: NotNegative = 0.0
    """Quantization of the intensity (0..1); 0 none."""
    mount_m: float = 1.73
    """Height of the origin of `velo` above the road."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.elevation_deg) != len(self.origin_m):
            raise ValueError(
                f"LidarSpec {self.name}: {len(self.elevation_deg)} elevations but {len(self.origin_m)} origins; "
                "give one of each for every beam (origin 0.0 for a sensor with a single origin)"
            )
        if any(upper <= lower for upper, lower in zip(self.elevation_deg, self.elevation_deg[1:], strict=False)):
            raise ValueError(f"LidarSpec {self.name}: elevations must fall from beam to beam; list the top beam first")

    @property
    def rows(self) -> int:
        """How many beams the sensor has."""
        return len(self.elevation_deg)

    @property
    def elevation_rad(self) -> Float[np.ndarray, " rows"]:
        """Elevation of each beam, top beam first."""
        return np.deg2rad(np.asarray(self.elevation_deg, np.float64))


# Two blocks of 32 lasers with their own optics, about 1/3 degree apart above and 1/2 degree below; origins
# fall evenly within a block. Calibration of a KITTI-360 unit by Hough voting, as published with RangeLDM;
# KITTI's own unit is within 0.02 degrees and 2 mm of it (`fit_beams`).
_HDL64E_DEG = """
    1.933 1.570 1.304 0.869 0.575 0.177 -0.089 -0.452 -0.806 -1.205 -1.495 -1.837 -2.208 -2.550 -2.877 -3.239
    -3.541 -3.940 -4.218 -4.588 -4.915 -5.253 -5.611 -5.958 -6.332 -6.679 -7.001 -7.291 -7.682 -8.060 -8.314 -8.717
    -9.027 -9.575 -10.066 -10.473 -10.960 -11.601 -12.116 -12.567 -13.043 -13.486 -14.054 -14.597 -15.189 -15.657
    -16.176 -16.555 -17.191 -17.735 -18.331 -18.802 -19.322 -19.737 -20.220 -20.788 -21.324 -21.940 -22.439 -22.858
    -23.322 -23.970 -24.510 -24.993
"""
_HDL64E_M = (*np.linspace(0.210, 0.198, 32), *np.linspace(0.126, 0.115, 32))


def _bytes(
    name: str,
    elevation_deg: tuple[float, float],
    rows: int,
    *,
    columns: int,
    seen_m: tuple[float, float],
    step_m: float,
    mount_m: float,
) -> LidarSpec:
    """A sensor with one origin, whose beams are spaced evenly from top to bottom and whose intensity is a byte."""
    even = tuple(float(e) for e in np.linspace(*elevation_deg, rows).round(4))
    return LidarSpec(
        *(name, even, (0.0,) * rows, columns, *seen_m), range_step_m=step_m, intensity_step=1 / 255, mount_m=mount_m
    )


_SENSORS = (
    # As KITTI drives it: intensity in hundredths. Its firings lie 0.1794 degrees apart, 2007 a turn, but for every
    # seventh, which comes after half a step: whole turns have a fourteenth more, and `jaxsim frames` counts them.
    LidarSpec(
        name="hdl64e",
        elevation_deg=tuple(float(e) for e in _HDL64E_DEG.split()),
        origin_m=tuple(round(float(h), 5) for h in _HDL64E_M),
        columns=2007,
        min_range_m=0.9,
        max_range_m=120.0,
        range_step_m=0.002,
        intensity_step=0.01,
        mount_m=1.73,
    ),
    # As nuScenes drives it: 20 Hz, a firing every 46.08 us.
    _bytes("hdl32e", (10.67, -30.67), 32, columns=1085, seen_m=(1.0, 100.0), step_m=0.002, mount_m=1.84),
    # 10 Hz, a firing every 55.296 us.
    _bytes("vlp16", (15.0, -15.0), 16, columns=1808, seen_m=(0.5, 100.0), step_m=0.002, mount_m=1.8),
    _bytes("os1_128", (22.5, -22.5), 128, columns=1024, seen_m=(0.3, 170.0), step_m=0.001, mount_m=1.8),
)
PRESETS: dict[str, LidarSpec] = {spec.name: spec for spec in _SENSORS}


def preset(name: str) -> LidarSpec:
    """The sensor of that name. Raises ValueError that lists the known names."""
    if name not in PRESETS:
        raise ValueError(f"no LiDAR named {name!r}; known: {', '.join(PRESETS)}")
    return PRESETS[name]


def full_grid(spec: LidarSpec, columns: int | None = None) -> PolarGrid:
    """The whole turn, cut behind the car: azimuth falls from just under +pi to just over -pi, forward in the middle."""
    return window_grid(spec, np.pi, -np.pi, columns=columns or spec.columns)


def window_grid(
    spec: LidarSpec,
    azimuth_left_rad: float,
    azimuth_right_rad: float,
    *,
    columns: int,
    rows: tuple[int, int] | None = None,
) -> PolarGrid:
    """Lines `rows` (first, stop; all by default) between two azimuths, which are the outer edges of the border cells.

    Raises ValueError for an empty or reversed window, more than a turn, and lines that the sensor does not have.
    """
    first, stop = rows or (0, spec.rows)
    width = float(azimuth_left_rad) - float(azimuth_right_rad)
    if not 0 < width <= 2 * np.pi + 1e-6:
        raise ValueError(
            f"azimuth window from {azimuth_left_rad:.4f} (left) to {azimuth_right_rad:.4f} (right) rad "
            f"spans {width:.4f}; azimuth falls from left to right, by at most a turn (add 2 pi to the left edge of "
            "a window across the rear)"
        )
    if columns < 2:
        raise ValueError(f"a polar grid needs 2 columns or more, got {columns}")
    if not 0 <= first < stop <= spec.rows:
        raise ValueError(f"rows {first}..{stop} (stop excluded) do not lie in the {spec.rows} lines of {spec.name}")
    centre, step = (float(azimuth_left_rad) + float(azimuth_right_rad)) / 2, width / columns
    azimuth = centre + ((columns - 1) / 2 - np.arange(columns)) * step
    return PolarGrid(
        azimuth.astype(np.float32),
        spec.elevation_rad[first:stop].astype(np.float32),
        np.asarray(spec.origin_m[first:stop], np.float32),
    )


def grid_difference(a: PolarGrid, b: PolarGrid) -> str:
    """In words, the first thing in which two grids differ by more than SAME_WITHIN; empty where they are one grid."""
    for name in ("azimuth_rad", "elevation_rad", "origin_m"):
        first = np.asarray(getattr(a, name))
        second = np.asarray(getattr(b, name))
        if first.shape != second.shape:
            return f"{name} ({first.size} and {second.size} values)"
        if not np.allclose(first, second, rtol=0, atol=SAME_WITHIN):
            return f"{name} (up to {np.abs(first - second).max():.4g} apart)"
    return ""


def same_grid(a: PolarGrid, b: PolarGrid) -> bool:
    """Whether two grids have the same rays: angles and origins, to SAME_WITHIN."""
    return not grid_difference(a, b)
