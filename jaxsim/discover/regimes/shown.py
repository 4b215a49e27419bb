"""A regime as the verdict holds it: where, how large inside and outside, and the sizes along what divides."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.fit import on_top
from jaxsim.discover.regimes.cells import Cells, cells
from jaxsim.discover.regimes.confine import Confined
from jaxsim.discover.regimes.questions import Facts
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import ratio_interval
from jaxsim.discover.verdict import Interval, Regime
from jaxsim.effects.region import within

OF_FIT = "of the fit inside"
"""Unit of sizes."""


def sizes(one: Confined, facts: Facts) -> tuple[Interval, Interval]:
    """The effect's size inside, and beside it outside, in units of the fit inside; intervals from the scatter of
    scenes."""
    result = one.step.fit
    law = one.step.chosen.effect
    inside = cells(law, one.problem, z=result.z, noise=result.noise, sector=facts.sector, sectors=facts.sectors)
    # Outside is asked with the effect in place inside, where nothing is left to ask for.
    opposite = within(one.plain, one.region, one.frames, outside=True)
    beside = replace(one.problem, ev=on_top(law, one.problem, result.z).ev)
    outside = cells(opposite, beside, z=result.z, noise=result.noise, sector=facts.sector, sectors=facts.sectors)
    return _size(inside, facts), _size(outside, facts)


def _size(of: Cells, facts: Facts) -> Interval:
    """The slope at none of the effect over the curvature: the step to the maximum."""
    top = np.bincount(facts.scene, (of.slope + of.curvature).sum(1), facts.scene_count)
    bottom = np.bincount(facts.scene, of.curvature.sum(1), facts.scene_count)
    # Scenes that lie on the other side say nothing, and have no part in the scatter.
    tells = bottom > RULES.regime_least_curvature * bottom.max()
    top = top[tells]
    bottom = bottom[tells]
    return Interval(float(top.sum() / bottom.sum()), *ratio_interval(top, bottom), OF_FIT)


class Told(NamedTuple):
    """Numbers of a regime."""

    inside: Interval
    outside: Interval
    p_value: float
    q_value: float
    judge_nats: float


def regime_of(one: Confined, divides: str, told: Told, *, facts: Facts) -> Regime:
    """The verdict's entry, with the size that each scene or sector asks for, had the effect been fitted everywhere."""
    result = one.step.fit
    whole = cells(one.plain, one.problem, z=result.z, noise=result.noise, sector=facts.sector, sectors=facts.sectors)
    azimuth = np.asarray(facts.scan.grid.azimuth_rad, float)
    columns = np.asarray(one.region.in_sector(azimuth))
    if divides == "azimuth":
        x = azimuth[[(2 * k + 1) * len(azimuth) // (2 * facts.sectors) for k in range(facts.sectors)]]
        size = _size_at(whole.slope.sum(0), whole.curvature.sum(0))
        held = np.asarray(one.region.in_sector(x))
    else:
        # Of a single drive, whose sectors are its scenes, each has all moments: frames are shown instead.
        group = facts.scene if len(set(facts.names)) > 1 else np.unique(facts.frame, return_inverse=True)[1]
        size = _size_at(np.bincount(group, whole.slope.sum(1)), np.bincount(group, whole.curvature.sum(1)))
        first = np.unique(group, return_index=True)[1]
        time_s = np.asarray(facts.scan.time_s, float)[facts.frame[first]]
        x = time_s if len(np.unique(time_s)) == len(first) else np.arange(len(first), dtype=float)
        held = one.frames[facts.frame[first]]
    return Regime(
        effect=one.plain.plain_name,
        divides=divides,
        where=one.region,
        share=float(one.frames.mean() * columns.mean()),
        **told._asdict(),
        applied=one.region.acts,
        x=tuple(map(float, x)),
        sizes=tuple(map(float, size)),
        held=tuple(map(bool, held)),
    )


def _size_at(slope: Float[np.ndarray, " k"], curvature: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """The size that each place asks for; NaN where next to nothing tells it."""
    tells = curvature > RULES.regime_least_curvature * curvature.max()
    return np.where(tells, 1 + slope / np.maximum(curvature, 1e-9), np.nan)
