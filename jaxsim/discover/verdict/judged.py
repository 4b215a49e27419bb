"""What judge scenes, to which nothing was fitted, show of an answer: gaps, and curves and frames for the report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Real

from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict.values import Interval


@dataclass(frozen=True)
class Gained:
    """Log-likelihood that one channel of unseen scenes gains by the effects, nats per scene."""

    value: float
    low: float
    """90 % interval, from the scatter between scenes."""
    high: float
    floor: float
    """What free curves along the named effects' covariates gain with the same data."""
    placebo: float
    """The same with the runner-up in place of the named effect."""
    win_rate: float
    """Share of judge scenes that gain."""
    unit: str = "nats per scene"


@dataclass(frozen=True)
class Gap:
    """One channel's distance between simulation and measurement on judge scenes."""

    before: float
    after: float
    low: float
    """90 % interval of `before - after`, from the scatter between scenes."""
    high: float
    unit: str
    floor: float
    """What free curves along the named effects' covariates reach with the same data."""
    placebo: float
    """The same with the runner-up in place of the named effect."""
    win_rate: float
    """Share of judge scenes where it shrank."""
    gained: Gained | None = None
    """None where no likelihood is computed (unpaired)."""

    @property
    def not_worse(self) -> bool:
        """Whether the channel is shown (95 %, one-sided) to be worse by less than `Rules.not_worse_share` of its
        distance."""
        return self.low > -RULES.not_worse_share * self.before


@dataclass(frozen=True)
class CurveLine:
    """Mean residual along a covariate on judge scenes, before and after the effects were added."""

    channel: str
    covariate: str
    unit: str
    """Unit of the residual: nats of ln I, m of range, share of rays lost."""
    x: Float[np.ndarray, " k"]
    before: Float[np.ndarray, " k"]
    after: Float[np.ndarray, " k"]
    band: Float[np.ndarray, " k"]
    """Half width of the 90 % interval of `before`, from the scatter between scenes; NaN where fewer than two have a
    value."""
    spread: bool = False
    """Whether it is not the mean of the residuals but their spread over the expected one, less 1."""
    edges: Float[np.ndarray, " k+1"] | None = None
    """Of the groups of rays that the points are means of: each holds what lies from one to below the next. None where
    it is not kept (unpaired)."""

    def group_of(self, values: Real[np.ndarray, "*n"]) -> Int[np.ndarray, "*n"]:
        """The group of each value of the covariate; -1 for all where the edges are not kept."""
        if self.edges is None:
            return np.full(np.shape(values), -1)
        return np.clip(np.searchsorted(self.edges, values, side="right") - 1, 0, len(self.x) - 1)


@dataclass(frozen=True)
class JudgeFrame:
    """One frame of a judge scene, ray by ray (n rays)."""

    name: str
    scene: str
    """Empty where it holds several: sectors of one drive."""
    row: Int[np.ndarray, " n"]
    column: Int[np.ndarray, " n"]
    range_m: Float[np.ndarray, " n"]
    """As measured; of rays that were lost, as simulated."""
    returned: Bool[np.ndarray, " n"]
    before: dict[str, Float[np.ndarray, " n"]]
    """Residuals of each channel in its own unit, NaN where it is not compared."""
    after: dict[str, Float[np.ndarray, " n"]]
    groups: tuple[Int[np.ndarray, " n"], ...] = ()
    """For each curve of the result, the group of each ray, -1 where it is in none."""


@dataclass(frozen=True)
class Judged:
    """Gaps by channel, the closure, and what a report draws (`Result` says what maps and curves hold)."""

    gap: dict[str, Gap]
    closure: Interval | None
    maps_before: dict[str, Float[np.ndarray, "r c"]]
    maps_after: dict[str, Float[np.ndarray, "r c"]]
    curves: tuple[CurveLine, ...]
    frames: tuple[JudgeFrame, ...] = ()
