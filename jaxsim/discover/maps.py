"""What a report draws of judge scenes: residuals on the polar grid, and along the named effects' own covariates."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.discover.fit import Problem
from jaxsim.discover.localise import CATEGORICAL, COVARIATES
from jaxsim.discover.over_scenes import half_width
from jaxsim.discover.residuals import residuals
from jaxsim.discover.result import CurveLine
from jaxsim.effects import Effect

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


RESIDUAL_UNITS = {
    "intensity": "ln I, measured minus simulated",
    "range": "m, measured minus simulated",
    "drop": "share lost, measured minus expected",
}


def curves_along(
    before: Problem, after: Problem, fitted: np.ndarray, judged: np.ndarray, unit: np.ndarray, effects: Sequence[Effect]
) -> tuple[CurveLine, ...]:
    """Mean residual along each named effect's own covariates, on judged blocks."""
    wanted = {
        (channel, covariate): None
        for effect in effects
        for channel in effect.channels
        for covariate in effect.covariates
    }
    old, new = residuals(before, fitted), residuals(after, fitted)
    rays = jax.tree.map(lambda leaf: np.asarray(leaf)[judged] if np.ndim(leaf) else leaf, before.ev.rays)
    lines = []
    for channel, covariate in wanted:
        if covariate not in COVARIATES:
            continue
        x = np.asarray(COVARIATES[covariate](rays), float)
        counts = old[channel][2][judged] & new[channel][2][judged]
        if counts.sum() < 200:
            continue
        of_unit = np.broadcast_to(unit[judged][:, None, None], counts.shape)[counts]
        x = x[counts]
        values = np.unique(x)
        # One point a beam or class; of other covariates, as many rays in each bin.
        edges = [*values, np.inf] if covariate in CATEGORICAL else np.unique(np.quantile(x, np.linspace(0, 1, 17)))
        if len(edges) < 3:
            continue
        place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
        size = len(edges) - 1
        n = np.maximum(np.bincount(place, minlength=size), 1)
        means = [np.bincount(place, r[channel][0][judged][counts], minlength=size) / n for r in (old, new)]
        scenes = []
        for u in np.unique(of_unit):
            own = of_unit == u
            k = np.bincount(place[own], minlength=size)
            total = np.bincount(place[own], old[channel][0][judged][counts][own], minlength=size)
            scenes.append(np.where(k > 0, total / np.maximum(k, 1), np.nan))
        centre, band = np.bincount(place, x, minlength=size) / n, half_width(np.array(scenes))
        lines.append(CurveLine(channel, covariate, RESIDUAL_UNITS[channel], centre, means[0], means[1], band))
    return tuple(lines)
