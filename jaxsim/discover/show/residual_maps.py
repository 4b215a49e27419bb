"""Residuals of judge scenes on the polar grid, as a report draws them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.residuals import residuals

MAP_COLUMNS = 32
"""Columns of a residual map, before it is spread over the grid: rays are thinned to whole columns."""


def maps_of(problem: Problem, fitted: np.ndarray, judged: np.ndarray) -> dict[str, Float[np.ndarray, "r c"]]:
    """Mean residual of the judged blocks on the grid, by channel."""
    columns = len(np.asarray(problem.scan.grid.azimuth_rad))
    bins = min(columns, MAP_COLUMNS)
    row, column = (np.asarray(part)[judged] for part in (problem.ev.rays.row, problem.ev.rays.column))
    place = row * bins + column * bins // columns
    rows = int(row.max()) + 1
    spread = np.arange(columns) * bins // columns
    maps = {}
    for name, (off, _, counts) in residuals(problem, fitted).items():
        keep = counts[judged]
        count = np.bincount(place[keep], minlength=rows * bins)
        total = np.bincount(place[keep], off[judged][keep], minlength=rows * bins)
        mean = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(rows, bins)
        maps[name] = mean[:, spread]
    return maps
