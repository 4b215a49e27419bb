"""How large an effect is inside its region, outside, and at every place, in units of the fit inside.

The size of some rays is the share of the effect (`cells`) at which their log-likelihood is largest. It is sought among
a few shares, for not every likelihood is a parabola: scenes that lose hardly any return by themselves say far more
clearly that they lose none at random than a line from none to all of it would.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.fit import Problem, on_top
from jaxsim.discover.model.parameters import fitted_parameters
from jaxsim.discover.regimes.cells import Shares
from jaxsim.discover.regimes.confine import Confined
from jaxsim.discover.regimes.questions import Facts
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Interval
from jaxsim.effects import Law
from jaxsim.effects.region import within
from jaxsim.metrics.intervals import jackknife_interval

OF_FIT = "of the fit inside"
"""Unit of sizes."""
SIZE_SHARES = np.array([0.0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0])
"""Shares at which slopes are taken: close together where losses and noises of next to nothing change theirs most."""
SIZE_ENDS = (-1.0, 3.0)
"""Sizes beyond these are told as these: no line holds so far out."""


class Sized(NamedTuple):
    """An effect in its region, with its sizes."""

    confined: Confined
    inside: Interval
    outside: Interval
    slopes: Float[np.ndarray, "k b c"]
    """Every column's (`slopes_of`): inside for more of the effect there, outside for any of it, beside all of it
    inside. With one share for both, what streets have in common would be fitted to neither."""


def sized(confined: Confined, facts: Facts) -> Sized:
    """The sizes inside, and beside it outside; intervals from the scatter of scenes."""
    law = confined.step.chosen.effect
    # Outside is asked with the effect in place inside, where nothing is left to ask for.
    opposite = within(confined.plain, confined.region, confined.frames, outside=True)
    beside = replace(confined.problem, ev=on_top(law, confined.problem, confined.step.fit.z).ev)
    inside = slopes_of(law, confined.problem, confined)
    outside = slopes_of(opposite, beside, confined)
    least = least_size(confined.plain)
    both = [size_of(_of_scenes(slopes, facts), least) for slopes in (inside, outside)]
    # Neither acts on the columns of the other.
    return Sized(confined, both[0], both[1], inside + outside)


def least_size(law: Law) -> float:
    """The least size that there is: of losses no less than none."""
    one_sided = all(p.low == p.neutral for p in fitted_parameters(law).values())
    return 0.0 if one_sided else SIZE_ENDS[0]


def slopes_of(law: Law, problem: Problem, confined: Confined) -> Float[np.ndarray, "k b c"]:
    """Every column's slope at each of `SIZE_SHARES`, of a law with the numbers of the fit in the region."""
    shares = Shares.of(law, problem, confined.step.fit)
    return np.stack([shares.slope(float(share)).sum(-1) for share in SIZE_SHARES])


def sizes_at(
    slopes: Float[np.ndarray, "k b c"], group: Int[np.ndarray, "b c"], groups: int, *, least: float = SIZE_ENDS[0]
) -> Float[np.ndarray, " g"]:
    """The size, no less than `least`, that each group of columns asks for; NaN where next to nothing tells it."""
    by_group = np.stack([np.bincount(group.ravel(), slope.ravel(), groups) for slope in slopes])
    return np.where(_tells(by_group), np.maximum(share_of(by_group), least), np.nan)


def size_of(by_scene: Float[np.ndarray, "k n"], least: float = SIZE_ENDS[0]) -> Interval:
    """The size, no less than `least`, that all scenes ask for together."""
    # Scenes that lie on the other side say nothing, and have no part in the scatter.
    tell = by_scene[:, _tells(by_scene)]
    total = tell.sum(1, keepdims=True)
    value = float(share_of(total)[0])
    low, high = jackknife_interval(value, share_of(total - tell))
    return Interval(max(value, least), max(low, least), max(high, least), OF_FIT)


def share_of(slopes: Float[np.ndarray, "k n"]) -> Float[np.ndarray, " n"]:
    """The share at which slopes at `SIZE_SHARES` become 0: beyond all by the line from none to all, the most that
    counts where it never falls; below none by the steeper of it and the line through the first two."""
    first, last = slopes[0], slopes[-1]
    # The first pair of shares between which it falls through 0.
    k = np.argmax((slopes[:-1] > 0) & (slopes[1:] <= 0), axis=0)
    at = np.arange(slopes.shape[1])
    above, below = slopes[k, at], slopes[k + 1, at]
    steeper = np.maximum(first - last, (first - slopes[1]) / SIZE_SHARES[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        between = SIZE_SHARES[k] + (SIZE_SHARES[k + 1] - SIZE_SHARES[k]) * above / (above - below)
        below_none = np.where(steeper > 0, first / steeper, SIZE_ENDS[0])
        above_all = np.where(last < first, first / (first - last), SIZE_ENDS[1])
        beyond = np.where(first > 0, above_all, below_none)
    return np.where((first > 0) & (last <= 0), between, np.clip(beyond, *SIZE_ENDS))


def _of_scenes(slopes: Float[np.ndarray, "k b c"], facts: Facts) -> Float[np.ndarray, "k n"]:
    return np.stack([np.bincount(facts.scene, slope.sum(1), facts.scene_count) for slope in slopes])


def _tells(by_group: Float[np.ndarray, "k n"]) -> Bool[np.ndarray, " n"]:
    """Where the likelihood bends enough to tell a size, or falls from none on: where nothing is lost it is a line."""
    clear = np.maximum(by_group[0] - by_group[-1], -by_group[0])
    return clear > RULES.regime_least_curvature * clear.max()
