"""An effect fitted in a region alone: the region's ends, how the effect is called there, and how much it gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from jaxsim.discover.model.fit import Fit, Problem, fit
from jaxsim.discover.name.candidates import Candidate, rank_effects
from jaxsim.discover.name.select import FittedStep, much_richer, simplest, worse
from jaxsim.discover.regimes.cells import cells_of
from jaxsim.discover.regimes.questions import Facts, arc
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped
from jaxsim.effects import Law
from jaxsim.effects.region import Region, within
from jaxsim.geometry import spans_turn


@dataclass(frozen=True)
class Confined:
    """An effect in its region."""

    step: FittedStep
    """The step whose effect is a law that acts there alone (`within`)."""
    plain: Law
    region: Region
    frames: Bool[np.ndarray, " f"]
    problem: Problem
    """What it was fitted on top of."""
    advantage: float
    """Held-out nats of the find scenes over the same effect everywhere."""


def frames_in(region: Region, facts: Facts) -> Bool[np.ndarray, " f"]:
    """Frames that lie in a region, each by its own time: scenes were asked by their mean moments, and drives that
    overlap in time may lie on both sides of a cut."""
    inside = np.asarray(region.in_time(np.asarray(facts.scan.time_s)))
    if region.tag is not None:
        inside = inside & np.asarray(facts.scan.tags[region.tag])
    return inside & (np.isin(facts.names, region.scenes) if region.scenes else True)


def confine(
    problem: Problem, candidates: Sequence[Candidate], region: Region, *, facts: Facts, ranking: Sequence[Candidate]
) -> Confined | None:
    """The best of `candidates`, the one whose region it is first, fitted in the region on top of `problem`; None where
    the region gains too little over the effect everywhere. `ranking` is that of the step."""
    frames = frames_in(region, facts)
    plain = {candidate.effect.plain_name: candidate for candidate in candidates if not candidate.effect.of_recording}
    laws = []
    for candidate in plain.values():
        # Fits begin where those to all scenes ended, too: there borders between all and nothing were found already.
        starts = (*candidate.effect.starts, *candidate.fitted_values)
        laws.append(replace(within(candidate.effect, region, frames), starts=starts))
    ranked = rank_effects(problem, laws)
    first = next(candidate for candidate in ranked if candidate.effect.plain_name == next(iter(plain)))
    best = named_in_part(first, ranked)
    everywhere = plain[best.effect.plain_name]
    advantage = float(clipped(best.by_scene - everywhere.by_scene).sum())
    if best.total <= RULES.bar_nats or advantage < RULES.regime_nats:
        return None
    result = fit(best.effect, problem, starts=best.fitted_values)
    alike = tuple(c for c in ranked if c is not best and c.total > RULES.bar_nats and not worse(c, best))
    alike = tuple(c for c in alike if not much_richer(c, best))
    step = FittedStep(best, alike, tuple(ranking), result)
    return Confined(step, everywhere.effect, region, frames, problem, advantage)


def named_in_part(first: Candidate, ranked: Sequence[Candidate]) -> Candidate:
    """The one that was asked about, or what is clearly better in the region; and the simplest that gains as much, as
    where effects are named everywhere."""
    better = [candidate for candidate in ranked if worse(first, candidate)]
    return simplest(better or [first, *(candidate for candidate in ranked if candidate is not first)])


def sharpened(region: Region, effect: Law, result: Fit, *, problem: Problem, facts: Facts) -> Region:
    """The region with its ends to a column: the arc within one and a half sectors of them that gains most of an effect
    fitted to all, where a column inside has the size of the whole region and one outside none.

    Sectors are asked about in steps, and columns of a region that lie outside the effect's make it look smaller."""
    columns = facts.scan.range_m.shape[2]
    whole = cells_of(effect, problem, result, sector=facts.column, sectors=columns)
    slope = whole.slope.sum(0)
    curvature = whole.curvature.sum(0)
    inside = np.asarray(region.in_sector(np.asarray(facts.scan.grid.azimuth_rad)))
    size = 1 + slope[inside].sum() / curvature[inside].sum()
    # From none of the effect to this size: the slope at none of it less half of what bends it.
    gain = (slope + curvature) * size - curvature * size**2 / 2
    reach = max(1, 3 * columns // (2 * facts.sectors))
    # The region's columns in a row, the turn cut open opposite of it.
    first = int(np.flatnonzero(inside & ~np.roll(inside, 1))[0])
    length = int(inside.sum())
    turns = bool(spans_turn(facts.scan.grid))
    before = min(reach, columns - length) if turns else min(reach, first)
    after = min(reach, columns - length - before) if turns else min(reach, columns - first - length)
    order = np.arange(first - before, first + length + after) % columns
    # Sums of gain up to each column: the best beginning and end are found apart.
    total = np.concatenate([[0.0], np.cumsum(gain[order])])
    begin = int(np.argmin(total[: before + reach + 1]))
    end = len(order) - int(np.argmax(total[::-1][: after + reach + 1]))
    if end <= begin:
        return region
    return arc(facts.scan, first - before + begin, end - begin)
