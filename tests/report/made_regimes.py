"""Regimes made by hand."""

from dataclasses import replace

import numpy as np

from jaxsim.discover.verdict import Interval, Regime, Result
from jaxsim.effects.region import Region
from tests.report import results

LATE = Region(time_s=(90.0, None))
BEHIND = Region(azimuth_rad=(3.0, 3.5))


def regime(where: Region, divides: str = "time") -> Regime:
    inside, outside = (Interval(v, v - 0.1, v + 0.1, "of the fit inside") for v in (1.0, 0.02))
    return Regime(
        effect="beam_gain",
        divides=divides,
        where=where,
        share=0.5,
        inside=inside,
        outside=outside,
        p_value=0.004,
        q_value=0.02,
        judge_nats=120.0,
        applied=where.acts,
        x=(0.0, 60.0, 120.0, 180.0),
        sizes=(0.1, float("nan"), 1.1, 0.9),
        held=(False, False, True, True),
    )


def with_regime(one: Regime, result: Result | None = None):
    result = result or results.named()
    return replace(result, verdict=replace(result.verdict, regimes=(one,)))


def sectors(count: int = 8) -> Regime:
    """One that acts in the two sectors about the back."""
    azimuth = np.deg2rad(180 - 360 * (np.arange(count) + 0.5) / count)
    held = tuple(bool(abs(one) > np.deg2rad(150)) for one in azimuth.tolist())
    more = {
        "effect": "window_contamination",
        "x": tuple(azimuth.tolist()),
        "sizes": tuple(np.where(held, 1.0, 0.1).tolist()),
        "held": held,
    }
    return replace(regime(BEHIND, "azimuth"), **more)
