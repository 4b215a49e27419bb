"""The ends of a sector to a column: sectors are asked about in steps, and what lies in a region without the effect
makes the effect look smaller than it is."""

from __future__ import annotations

import numpy as np

from jaxsim.discover.model.fit import Fit, Problem
from jaxsim.discover.regimes.questions import Facts, arc
from jaxsim.discover.regimes.sizes import cells
from jaxsim.effects import Law
from jaxsim.effects.rays import spans_turn
from jaxsim.effects.region import Region


def sharpened(region: Region, effect: Law, fitted: Fit, *, problem: Problem, facts: Facts) -> Region:
    """The arc of columns within one and a half sectors of the region's ends that gains most of an effect fitted to all,
    where a column inside has the size of the whole region and one outside none."""
    columns = facts.scan.range_m.shape[2]
    of = cells(effect, problem, z=fitted.z, noise=fitted.noise, sector=facts.column, sectors=columns)
    slope = of.slope.sum(0)
    curvature = of.curvature.sum(0)
    held = np.asarray(region.in_sector(np.asarray(facts.scan.grid.azimuth_rad)))
    size = 1 + slope[held].sum() / curvature[held].sum()
    # From none of the effect to this size: the slope at none of it less half of what bends it.
    gain = (slope + curvature) * size - curvature * size**2 / 2
    reach = max(1, 3 * columns // (2 * facts.sectors))
    # The region's columns in a row, the turn cut open opposite of it.
    first = int(np.flatnonzero(held & ~np.roll(held, 1))[0])
    length = int(held.sum())
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
