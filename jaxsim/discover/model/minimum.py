"""The minimum of an objective that is smooth, expensive, and known in single precision: L-BFGS-B with two additions.

What one beam's number changes may be a hundred times what another's does, and L-BFGS would learn that step by step: a
look beside the start tells each entry's curvature, and the search goes in units in which all are about as steep. And
SciPy's search along a line asks for a lower loss up to twenty times, ever nearer to where it began; where an effect
does nothing it asks for what single precision cannot show. Lines that promise nothing more are left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

LOOK = 0.02
"""How far, in standard deviations of the prior, the look beside the start goes."""
CORRECTIONS = 12
"""Pairs of steps and gradients from which L-BFGS knows the curvature: about as many as there are noise scales."""
FAILED = 2
"""Points of a line, one after another, that are no lower than what was found."""
RESOLVED = 4
"""Steps of single precision below which two losses cannot be told apart."""
Bounds = Sequence[tuple[float | None, float | None]]
"""The least and the most of each entry, None where there is none."""


class Point(NamedTuple):
    """What an objective says at x."""

    x: Float[np.ndarray, " n"]
    loss: float
    gradient: Float[np.ndarray, " n"]
    more: Any
    """Whatever else came out there."""


LossAt = Callable[[Float[np.ndarray, " n"]], Point]


def minimum(
    objective: LossAt,
    x: Float[np.ndarray, " n"],
    *,
    sd: Float[np.ndarray, " n"],
    bounds: Bounds,
    steps: int,
    enough: float,
) -> Point:
    """The lowest point found from `x`, within the bounds; done where a step gains less than `enough`, or after so many
    from where the search last began.

    `sd` are the entries' standard deviations by their prior: no entry is taken to be flatter than that.
    """
    low = np.array([-np.inf if low is None else low for low, _ in bounds])
    high = np.array([np.inf if high is None else high for _, high in bounds])
    start = objective(np.clip(x, low, high))
    # A look beside the start tells the curvature: up and down in turn, so that what neighbours share cancels, but for
    # entries that would leave their bounds.
    step = LOOK * sd * np.where(np.arange(len(sd)) % 2, -1.0, 1.0)
    outside = (start.x + step < low) | (start.x + step > high)
    scale = _scale(objective, start, np.where(outside, -step, step), sd=sd)
    search = _Search(objective, start, scale=scale, enough=enough)
    # SciPy asks for `enough` as a fraction of the loss.
    options = {"maxiter": steps, "ftol": enough / max(abs(start.loss), 1.0), "maxcor": CORRECTIONS}
    scaled = list(zip(low / scale, high / scale, strict=True))
    while True:
        before = search.begin()
        with suppress(_LeftError):
            minimize(search, before.x / scale, jac=True, method="L-BFGS-B", bounds=scaled, options=options)
            return search.lowest
        # The line may have been a bad one: what was learned of the curvature is forgotten, and the slope followed.
        if search.lowest.loss > before.loss - search.least:
            return search.lowest


def _scale(
    objective: LossAt, start: Point, step: Float[np.ndarray, " n"], *, sd: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Units of the entries, of which one look, at `step` from the start, tells: one over the root of the curvature."""
    curvature = np.abs((objective(start.x + step).gradient - start.gradient) / step)
    return 1 / np.sqrt(np.maximum(curvature, 1 / sd**2))


class _LeftError(Exception):
    """A search along a line was left."""


class _Search:
    """What SciPy asks, in scaled entries, and the lowest point that it was told of."""

    def __init__(self, objective: LossAt, start: Point, *, scale: Float[np.ndarray, " n"], enough: float) -> None:
        self.objective = objective
        self.lowest = start
        self.scale = scale
        self.enough = enough
        self.failed = 0
        self.begun = False

    def begin(self) -> Point:
        """The point to begin at: the lowest."""
        self.failed, self.begun = 0, False
        return self.lowest

    @property
    def least(self) -> float:
        """Nats that are worth a step, and that single precision tells apart."""
        return max(self.enough, RESOLVED * float(np.spacing(np.float32(abs(self.lowest.loss)))))

    def __call__(self, scaled: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        if not self.begun:  # SciPy asks for the beginning first, which is known
            self.begun = True
            return self.lowest.loss, self.lowest.gradient * self.scale
        point = self.objective(scaled * self.scale)
        if point.loss < self.lowest.loss:
            self.lowest, self.failed = point, 0
            return point.loss, point.gradient * self.scale
        self.failed += 1
        # A convex loss falls along a line by no more than its slope at the beginning says.
        promised = -float(self.lowest.gradient @ (point.x - self.lowest.x))
        if self.failed >= FAILED and promised < self.least:
            raise _LeftError
        return point.loss, point.gradient * self.scale
