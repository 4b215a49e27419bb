"""Residuals of judge scenes as a report draws them: along the named effects' own covariates, and on the polar grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.covariates import CATEGORICAL, COVARIATES
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.residuals import residuals
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import half_width
from jaxsim.discover.verdict import CurveLine
from jaxsim.effects import Law

RESIDUAL_UNITS = {
    "intensity": "ln I, measured minus simulated",
    "range": "m, measured minus simulated",
    "drop": "share lost, measured minus expected",
}
SPREAD_UNIT = "spread over the one expected, less 1"
BINS = 16
"""Groups of a covariate along which a curve is drawn."""
MAP_COLUMNS = 32
"""Columns of a residual map, before it is spread over the grid: rays are thinned to whole columns."""


def residual_curves(
    before: Problem,
    after: Problem,
    *,
    fitted: Float[np.ndarray, " b"],
    scene: Int[np.ndarray, " b"],
    effects: Sequence[Law],
) -> tuple[CurveLine, ...]:
    """Mean residual along each named effect's own covariates, on the blocks that are not fitted; where an effect makes
    ranges scatter, also the residuals' spread over the one that each ray is expected to have, for their mean shows
    nothing of it. `scene` is that of each block."""
    judged = np.asarray(fitted) == 0
    wanted = {
        (channel, covariate): None
        for effect in effects
        for channel in effect.channels
        for covariate in effect.covariates
        if covariate in COVARIATES
    }
    old = residuals(before, fitted)
    new = residuals(after, fitted)
    rays = jax.tree.map(lambda leaf: np.asarray(leaf)[judged] if np.ndim(leaf) else leaf, before.ev.rays)
    # Of an effect that only makes ranges scatter no mean shows anything.
    scatters = bool((np.asarray(after.ev.rays.noise_m) > np.asarray(before.ev.rays.noise_m)).any())
    lines = []
    for channel, covariate in wanted:
        counts = old[channel][2][judged] & new[channel][2][judged]
        if counts.sum() < RULES.fewest_curve_rays:
            continue
        of_scene = np.broadcast_to(scene[judged][:, None, None], counts.shape)[counts]
        bins = Bins.of(np.asarray(COVARIATES[covariate](rays), float)[counts], covariate, of_scene)
        if bins is None:
            continue
        sides = [[part[judged][counts] for part in side[channel][:2]] for side in (old, new)]
        means = [off for off, _ in sides]
        unit = RESIDUAL_UNITS[channel]
        lines.append(CurveLine(channel, covariate, unit, bins.centre, *bins.curve(*means), edges=bins.edges))
        if scatters and channel == "range":
            # z has a variance of 1 where the noise is what the model expects; its square shows by how much it is not.
            squares = [z**2 for _, z in sides]
            spread = bins.curve(*squares, shown=lambda mean: np.sqrt(mean) - 1)
            lines.append(
                CurveLine(channel, covariate, SPREAD_UNIT, bins.centre, *spread, spread=True, edges=bins.edges)
            )
    return tuple(lines)


@dataclass(frozen=True)
class Bins:
    """Rays in groups of about the same covariate (k groups)."""

    index: Int[np.ndarray, " n"]
    """The group of each ray."""
    scene: Int[np.ndarray, " n"]
    centre: Float[np.ndarray, " k"]
    edges: Float[np.ndarray, " k+1"]

    @classmethod
    def of(cls, x: Float[np.ndarray, " n"], covariate: str, scene: Int[np.ndarray, " n"]) -> Bins | None:
        """One group a beam or class; of other covariates, as many rays in each. None where all rays are alike."""
        if covariate in CATEGORICAL:
            # The last category is closed by infinity, as a bin needs two ends.
            edges = np.array([*np.unique(x), np.inf])
        else:
            # Ties make quantiles equal, and such groups are one.
            edges = np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))
        if len(edges) < 3:
            return None
        size = len(edges) - 1
        index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, size - 1)
        centre = np.bincount(index, x, size) / np.maximum(np.bincount(index, minlength=size), 1)
        return cls(index, scene, centre, edges)

    def mean(self, values: Float[np.ndarray, " n"], *, of: slice | np.ndarray = slice(None)) -> Float[np.ndarray, " k"]:
        """Mean of each group, of some rays; NaN where there is none."""
        count = np.bincount(self.index[of], minlength=len(self.centre))
        total = np.bincount(self.index[of], values[of], len(self.centre))
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    def curve(
        self,
        before: Float[np.ndarray, " n"],
        after: Float[np.ndarray, " n"],
        *,
        shown: Callable[[np.ndarray], np.ndarray] = lambda mean: mean,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Means before and after, as they are `shown`, and the half width of the 90 % interval of the former."""
        scenes = np.array([shown(self.mean(before, of=self.scene == one)) for one in np.unique(self.scene)])
        return shown(self.mean(before)), shown(self.mean(after)), half_width(scenes)


def residual_maps(problem: Problem, *, fitted: Float[np.ndarray, " b"]) -> dict[str, Float[np.ndarray, "r c"]]:
    """Mean residual of the blocks that are not fitted, on the grid, by channel."""
    judged = np.asarray(fitted) == 0
    columns = len(np.asarray(problem.scan.grid.azimuth_rad))
    row = np.asarray(problem.ev.rays.row)[judged]
    column = np.asarray(problem.ev.rays.column)[judged]
    shape = (int(row.max()) + 1, columns)
    maps = {}
    for name, (off, _, counts) in residuals(problem, fitted).items():
        keep = counts[judged]
        maps[name] = mean_on_grid(off[judged][keep], row[keep], column[keep], shape=shape)
    return maps


def mean_on_grid(
    values: Float[np.ndarray, " n"],
    row: Int[np.ndarray, " n"],
    column: Int[np.ndarray, " n"],
    *,
    shape: tuple[int, int],
) -> Float[np.ndarray, "r c"]:
    """Mean of the rays of each row and of each of MAP_COLUMNS groups of columns, spread over the grid of `shape`; NaN
    where there are none."""
    rows, columns = shape
    bins = min(columns, MAP_COLUMNS)
    cell = row * bins + column * bins // columns
    count = np.bincount(cell, minlength=rows * bins)
    total = np.bincount(cell, values, minlength=rows * bins)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(rows, bins)
    return mean[:, np.arange(columns) * bins // columns]
