"""Rasters of four kinds of sensor: angles of columns (falling azimuth) and rows (falling elevation)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SCAN_S = 0.1


class Sensor(NamedTuple):
    """elevation_deg: top and bottom; dense: how much closer the lines stand at the top (1: evenly); turn_deg: width."""

    rows: int
    columns: int
    elevation_deg: tuple[float, float]
    dense: float
    turn_deg: float
    beam_rad: float


SENSORS = {
    "spin16": Sensor(16, 900, (15.0, -15.0), 1.0, 360.0, 1.5e-3),
    "spin64": Sensor(64, 512, (4.0, -25.0), 1.5, 360.0, 0.8e-3),
    "front128": Sensor(128, 240, (13.0, -25.0), 1.15, 120.0, 0.6e-3),
    "raster": Sensor(80, 320, (12.5, -12.5), 1.0, 120.0, 1.0e-3),
}


class Grid(NamedTuple):
    """(columns,) azimuths and (rows,) elevations, rad."""

    azimuth: np.ndarray
    elevation: np.ndarray
    full_turn: bool
    beam_rad: float

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.elevation), len(self.azimuth)

    def directions(self) -> np.ndarray:
        """(rows, columns, 3) unit vectors, x forward, y left."""
        up, side = self.elevation[:, None], self.azimuth[None]
        flat = np.cos(up)
        return np.stack([flat * np.cos(side), flat * np.sin(side), np.sin(up) + 0 * side], -1)


def grid_of(name: str, rng: np.random.Generator, *, rows: int = 0, columns: int = 0) -> Grid:
    """The raster of a sensor, its lines off by up to a fifth of their distance; 0: as many as the sensor has.

    Raises:
        ValueError: no such sensor, or fewer than 2 rows or columns.
    """
    if name not in SENSORS:
        raise ValueError(f"sensor {name!r} is not known; choose one of {', '.join(SENSORS)}")
    s = SENSORS[name]
    rows, columns = rows or s.rows, columns or s.columns
    if rows < 2 or columns < 2:
        raise ValueError(f"{rows} rows and {columns} columns are too few; give 2 or more")
    share = (np.arange(rows) + 0.2 * rng.uniform(-1, 1, rows)) / (rows - 1)
    top, bottom = s.elevation_deg
    elevation = np.deg2rad(top + (bottom - top) * np.sign(share) * np.abs(share) ** s.dense)
    half = np.deg2rad(s.turn_deg / 2)
    azimuth = half - (np.arange(columns) + 0.5) * 2 * half / columns
    return Grid(azimuth, elevation, s.turn_deg >= 360, s.beam_rad)
