"""An effect fitted in a region alone: how it is called there, how much it gains, and its size inside and outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from jaxsim.discover.model.fit import Problem, fit, on_top
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.name.candidates import Candidate, rank_effects
from jaxsim.discover.name.select import FittedStep, padded, worse
from jaxsim.discover.regimes.questions import Facts
from jaxsim.discover.regimes.sizes import Cells, cells
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, ratio_interval
from jaxsim.discover.verdict import Interval
from jaxsim.effects import Law
from jaxsim.effects.region import WHOLE, Region, within

OF_FIT = "of the fit inside"
"""Unit of sizes."""


@dataclass(frozen=True)
class Confined:
    """An effect in its region."""

    step: FittedStep
    """Its effect is a law that acts there alone (`within`)."""
    plain: Law
    region: Region
    frames: Bool[np.ndarray, " f"]
    problem: Problem
    """What it was fitted on top of."""
    more: float
    """Held-out nats of the find scenes over the same effect everywhere."""


def frames_in(region: Region, facts: Facts) -> Bool[np.ndarray, " f"]:
    """Frames that lie in a region, whole scenes of it where moments divide."""
    inside = np.asarray(region.in_time(np.asarray(facts.scan.time_s)))
    if region.tag is not None:
        inside = inside & np.asarray(facts.scan.tags[region.tag])
    return inside & (np.isin(facts.names, region.scenes) if region.scenes else True)


def confine(
    problem: Problem,
    candidates: Sequence[Candidate],
    region: Region,
    *,
    facts: Facts,
    ranking: Sequence[Candidate],
) -> Confined | None:
    """The best of `candidates`, the one whose region it is first, fitted in the region on top of `problem`; None where
    the region gains too little over the effect everywhere. `ranking` is that of the step."""
    frames = frames_in(region, facts)
    plain = {one.effect.plain_name: one for one in candidates if one.effect.plain_name not in WHOLE}
    laws = []
    for one in plain.values():
        # Fits begin where those to all scenes ended, too: there borders between all and nothing were found already.
        ended = tuple(to_values(one.effect, each.z) for each in one.fits)
        laws.append(replace(within(one.effect, region, frames), starts=(*one.effect.starts, *ended)))
    ranked = rank_effects(problem, laws, null=problem.null_fits)
    first = next(one for one in ranked if one.effect.plain_name == next(iter(plain)))
    # The name that was given to all scenes stays unless another is clearly better here.
    best = next((one for one in ranked if one is first or worse(first, one)), first)
    everywhere = plain[best.effect.plain_name]
    more = float(clipped(best.by_scene - everywhere.by_scene).sum())
    if best.total <= RULES.bar_nats or more < RULES.regime_nats:
        return None
    starts = tuple(to_values(best.effect, one.z) for one in best.fits)
    everyone = np.ones(len(facts.unit), np.float32)
    fitted = fit(best.effect, problem, everyone, starts=starts)
    alike = tuple(c for c in ranked if c is not best and c.total > RULES.bar_nats and not worse(c, best))
    alike = tuple(c for c in alike if not padded(c, best))
    step = FittedStep(best, alike, tuple(ranking), fitted)
    return Confined(step, everywhere.effect, region, frames, problem, more)


def sizes(one: Confined, facts: Facts) -> tuple[Interval, Interval]:
    """The effect's size inside, and beside it outside, in units of the fit inside; intervals from the scatter of
    scenes."""
    fitted = one.step.fitted
    law = one.step.chosen.effect
    inside = cells(law, one.problem, z=fitted.z, noise=fitted.noise, sector=facts.sector, sectors=facts.sectors)
    opposite = within(one.plain, one.region, one.frames, outside=True)
    beside = replace(one.problem, ev=on_top(law, one.problem, fitted.z).ev)
    outside = cells(opposite, beside, z=fitted.z, noise=fitted.noise, sector=facts.sector, sectors=facts.sectors)
    return _size(inside, facts), _size(outside, facts)


def _size(of: Cells, facts: Facts) -> Interval:
    """The slope at none of the effect over the curvature: the step to the maximum."""
    top = np.bincount(facts.unit, (of.slope + of.curvature).sum(1), facts.units)
    bottom = np.bincount(facts.unit, of.curvature.sum(1), facts.units)
    # Scenes that lie on the other side say nothing, and have no part in the scatter.
    tells = bottom > RULES.regime_least_curvature * bottom.max()
    top = top[tells]
    bottom = bottom[tells]
    return Interval(float(top.sum() / bottom.sum()), *ratio_interval(top, bottom), OF_FIT)
