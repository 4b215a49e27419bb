"""Noise that a side has of its own: what both sides have alike at the same rays is none of either.

Simulated frames may hold a scan's own readings: those of a digital twin, of a network that is fed with its ranges, or
the scan itself. What was measured then has the same noise and texture at the same rays. With that common part c and
independent rests s and m, second differences have variances of c + s and c + m, and the two sides' difference has
s + m, so that c is half of the sum of the first two less the third.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.model.noise_levels import (
    Levels,
    neighbourhoods,
    noise_levels,
    range_bends,
    sd_of,
    second_difference,
)
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import FLOOR, Scan


def own_levels(simulated: Scan, measured: Scan) -> tuple[Levels, Levels]:
    """The levels of noise of both sides, without what they have in common where that is most of the simulator's
    (`Rules.common_noise`)."""
    ours, theirs = noise_levels(simulated), noise_levels(measured)
    found = neighbourhoods(simulated)
    inner, hole = np.asarray(found[0]), np.asarray(found[1])
    both = inner & np.asarray(neighbourhoods(measured)[0])
    common = common_variance(range_bends(simulated)[both], range_bends(measured)[both])
    ours, theirs = _less_range(ours, common), _less_range(theirs, common)
    bright = both & _bright(simulated) & _bright(measured)
    bends = [_intensity_bends(side)[bright] for side in (simulated, measured)]
    common = common_variance(*bends)
    ours, theirs = _less_intensity(ours, bends[0], common), _less_intensity(theirs, bends[1], common)
    # A ray that the sensor lost with the simulator was not lost by the simulator's own chance.
    returned = np.asarray(measured.hit)
    if hole.any() and returned[hole].mean() < (1 - RULES.common_noise) * returned[inner].mean():
        ours, theirs = replace(ours, loss=0.0), replace(theirs, loss=0.0)
    return ours, theirs


def common_variance(ours: Float[np.ndarray, " n"], theirs: Float[np.ndarray, " n"]) -> float:
    """Variance of what both sides' second differences have in common; 0 where that is not most of ours, or too few
    tell it."""
    if len(ours) < RULES.fewest_differences:
        return 0.0
    variance = [sd_of(np.abs(bend)) ** 2 for bend in (ours, theirs, ours - theirs)]
    common = (variance[0] + variance[1] - variance[2]) / 2
    return common if common > RULES.common_noise * variance[0] else 0.0


def _less_range(levels: Levels, common: float) -> Levels:
    """The noise on ranges, less a variance that is common."""
    rest = float(np.sqrt(max(levels.range_m**2 - common, 0.0)))
    return replace(levels, range_m=rest if rest > RULES.noisy_range_m else 0.0)


def _less_intensity(levels: Levels, bends: Float[np.ndarray, " n"], common: float) -> Levels:
    """Both parts of the noise on intensities, less the share of its variance that is common."""
    if not common:
        return levels
    variance = sd_of(np.abs(bends)) ** 2
    rest = max(variance - common, 0.0)
    if np.sqrt(rest) < RULES.noisy_intensity:
        return replace(levels, intensity=0.0, intensity_share=0.0)
    part = float(np.sqrt(rest / variance))
    return replace(levels, intensity=part * levels.intensity, intensity_share=part * levels.intensity_share)


def _intensity_bends(scan: Scan) -> Float[np.ndarray, "f r c"]:
    """Second differences of intensities along the row, over the mean of the three."""
    intensity = np.asarray(scan.intensity, np.float64)
    level = (np.roll(intensity, 1, 2) + intensity + np.roll(intensity, -1, 2)) / 3
    return second_difference(intensity) / np.maximum(level, FLOOR)


def _bright(scan: Scan) -> Bool[np.ndarray, "f r c"]:
    """Rays that read something, with their neighbours along the row."""
    lit = np.asarray(scan.intensity) > FLOOR
    return lit & np.roll(lit, 1, 2) & np.roll(lit, -1, 2)
