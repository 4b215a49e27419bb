"""What `discover` gives back: the verdict, the sensor model to simulate with, and what a report draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxsim.discover.survey import Candidate
from jaxsim.discover.verdict import Gap, Interval, Verdict
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import PolarGrid


@dataclass(frozen=True)
class CurveLine:
    """Mean residual along a covariate on judge scenes, before and after the effects were added."""

    channel: str
    covariate: str
    unit: str
    """Of the residual: nats of ln I, m of range, share of rays lost."""
    x: Float[np.ndarray, " k"]
    before: Float[np.ndarray, " k"]
    after: Float[np.ndarray, " k"]
    band: Float[np.ndarray, " k"]
    """Half width of the 90 % interval of `before`, from the scatter between scenes; NaN where fewer than two have a
    value."""
    spread: bool = False
    """Whether it is not the mean of the residuals but their spread over the expected one, less 1."""


@dataclass(frozen=True)
class Judged:
    """Gaps by channel, the closure, and what a report draws (`Result` says what maps and curves hold)."""

    gap: dict[str, Gap]
    closure: Interval | None
    maps_before: dict[str, Float[np.ndarray, "r c"]]
    maps_after: dict[str, Float[np.ndarray, "r c"]]
    curves: tuple[CurveLine, ...]


@dataclass(frozen=True)
class Result:
    """The answer and its evidence. Maps are mean residuals of judge frames on the polar grid (rows, columns), NaN
    where nothing was compared: measured minus simulated ln I (nats), range (m), and share of rays lost minus
    expected."""

    verdict: Verdict
    sensor: SensorModel
    grid: PolarGrid
    maps_before: dict[str, Float[np.ndarray, "r c"]]
    maps_after: dict[str, Float[np.ndarray, "r c"]]
    curves: tuple[CurveLine, ...]
    candidates: tuple[Candidate, ...] = ()
    """The whole first ranking with its fits, for who wants to choose by another rule."""
