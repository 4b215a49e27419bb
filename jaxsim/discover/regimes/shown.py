"""A regime as the verdict holds it: where, how large, and the sizes along what divides."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.discover.regimes.confine import Confined
from jaxsim.discover.regimes.questions import Facts
from jaxsim.discover.regimes.sizes import cells
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Interval, Regime


class Told(NamedTuple):
    """Numbers of a regime."""

    inside: Interval
    outside: Interval
    p_value: float
    q_value: float
    judge_nats: float


def shown(one: Confined, divides: str, told: Told, *, facts: Facts) -> Regime:
    """The verdict's entry, with the size that each scene or sector asks for, had the effect been fitted everywhere."""
    fitted = one.step.fitted
    of = cells(one.plain, one.problem, z=fitted.z, noise=fitted.noise, sector=facts.sector, sectors=facts.sectors)
    azimuth = np.asarray(facts.scan.grid.azimuth_rad, float)
    columns = np.asarray(one.region.in_sector(azimuth))
    if divides == "azimuth":
        x = azimuth[[(2 * k + 1) * len(azimuth) // (2 * facts.sectors) for k in range(facts.sectors)]]
        size = _size(of.slope.sum(0), of.curvature.sum(0))
        held = np.asarray(one.region.in_sector(x))
    else:
        # Of a single drive, whose sectors are the units, every unit has all moments: frames are shown instead.
        group = facts.unit if len(set(facts.names)) > 1 else np.unique(facts.frame, return_inverse=True)[1]
        size = _size(np.bincount(group, of.slope.sum(1)), np.bincount(group, of.curvature.sum(1)))
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


def _size(slope: Float[np.ndarray, " k"], curvature: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """The size that each place asks for; NaN where next to nothing tells it."""
    tells = curvature > RULES.regime_least_curvature * curvature.max()
    return np.where(tells, 1 + slope / np.maximum(curvature, 1e-9), np.nan)
