"""Residuals of judge scenes along the named effects' own covariates, before and after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.find.localise import CATEGORICAL, COVARIATES
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.residuals import residuals
from jaxsim.discover.scenes import half_width
from jaxsim.discover.verdict import CurveLine
from jaxsim.effects import Law

RESIDUAL_UNITS = {
    "intensity": "ln I, measured minus simulated",
    "range": "m, measured minus simulated",
    "drop": "share lost, measured minus expected",
}
SPREAD_UNIT = "spread over the one expected, less 1"
FEWEST = 200
"""Rays below which there is no curve."""


def curves_along(
    before: Problem, after: Problem, fitted: np.ndarray, judged: np.ndarray, unit: np.ndarray, effects: Sequence[Law]
) -> tuple[CurveLine, ...]:
    """Mean residual along each named effect's own covariates, on judged blocks; where an effect makes ranges scatter,
    also the residuals' spread over the one that each ray is expected to have, for their mean shows nothing of it."""
    wanted = {
        (channel, covariate): None
        for effect in effects
        for channel in effect.channels
        for covariate in effect.covariates
        if covariate in COVARIATES
    }
    old, new = residuals(before, fitted), residuals(after, fitted)
    rays = jax.tree.map(lambda leaf: np.asarray(leaf)[judged] if np.ndim(leaf) else leaf, before.ev.rays)
    scatters = bool((np.asarray(after.ev.rays.noise_m) > np.asarray(before.ev.rays.noise_m)).any())
    lines = []
    for channel, covariate in wanted:
        counts = old[channel][2][judged] & new[channel][2][judged]
        if counts.sum() < FEWEST:
            continue
        of_unit = np.broadcast_to(unit[judged][:, None, None], counts.shape)[counts]
        bins = Bins.of(np.asarray(COVARIATES[covariate](rays), float)[counts], covariate, of_unit)
        if bins is None:
            continue
        sides = [[part[judged][counts] for part in side[channel][:2]] for side in (old, new)]
        means = [off for off, _ in sides]
        lines.append(CurveLine(channel, covariate, RESIDUAL_UNITS[channel], bins.centre, *bins.curve(*means)))
        if scatters and channel == "range":
            squares = [z**2 for _, z in sides]
            spread = bins.curve(*squares, shown=lambda mean: np.sqrt(mean) - 1)
            lines.append(CurveLine(channel, covariate, SPREAD_UNIT, bins.centre, *spread, spread=True))
    return tuple(lines)


@dataclass(frozen=True)
class Bins:
    """Rays in groups of about the same covariate (k groups)."""

    place: Int[np.ndarray, " n"]
    unit: Int[np.ndarray, " n"]
    centre: Float[np.ndarray, " k"]

    @classmethod
    def of(cls, x: Float[np.ndarray, " n"], covariate: str, unit: Int[np.ndarray, " n"]) -> Bins | None:
        """One group a beam or class; of other covariates, as many rays in each. None where all rays are alike."""
        edges = (
            [*np.unique(x), np.inf] if covariate in CATEGORICAL else np.unique(np.quantile(x, np.linspace(0, 1, 17)))
        )
        if len(edges) < 3:
            return None
        place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
        size = len(edges) - 1
        return cls(place, unit, np.bincount(place, x, size) / np.maximum(np.bincount(place, minlength=size), 1))

    def mean(self, values: Float[np.ndarray, " n"], *, of: slice | np.ndarray = slice(None)) -> Float[np.ndarray, " k"]:
        """Of each group, of some rays; NaN where there is none."""
        count = np.bincount(self.place[of], minlength=len(self.centre))
        total = np.bincount(self.place[of], values[of], len(self.centre))
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    def curve(
        self,
        before: Float[np.ndarray, " n"],
        after: Float[np.ndarray, " n"],
        *,
        shown: Callable[[np.ndarray], np.ndarray] = lambda mean: mean,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Means before and after, as they are `shown`, and the half width of the 90 % interval of the former."""
        scenes = np.array([shown(self.mean(before, of=self.unit == u)) for u in np.unique(self.unit)])
        return shown(self.mean(before)), shown(self.mean(after)), half_width(scenes)
