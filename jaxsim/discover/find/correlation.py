"""Whether the two sides' intensities have anything to do with each other, without which no effect on them can be told.

Where they have not (frames of other streets that share a road, a channel that holds something else), any effect that
flattens the simulated intensity would gain, since it takes away what misleads.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import p_value, rank_correlation
from jaxsim.effects import Effect


def correlations(ev: Evidence) -> Float[np.ndarray, " s"]:
    """Each scene's rank correlation (Spearman's) between measured and simulated ln I, means of its surfaces; NaN
    where a scene shows too few surfaces, or one side has them all alike."""
    counts = np.asarray(ev.compared)
    surface = np.asarray(ev.surface)[np.asarray(ev.strip)][counts]
    scene = np.asarray(ev.scene)
    of = np.broadcast_to(scene[:, None, None], counts.shape)[counts]
    ours = np.asarray(ev.rays.log_intensity)[counts]
    theirs = np.asarray(ev.log_intensity)[counts]
    correlation = []
    for one in np.unique(scene):
        _, group = np.unique(surface[of == one], return_inverse=True)
        # Surfaces, not rays: the noise of a surface's rays would hide how surfaces rank.
        size = np.bincount(group)
        enough = size >= RULES.related_rays
        measured = np.bincount(group, theirs[of == one])[enough] / size[enough]
        simulated = np.bincount(group, ours[of == one])[enough] / size[enough]
        alike = enough.sum() < RULES.related_surfaces or min(np.ptp(measured), np.ptp(simulated)) < 1e-6
        # Ranks: a gamma or a gain of the sensor leaves them as they are.
        correlation.append(np.nan if alike else rank_correlation(measured, simulated))
    return np.array(correlation)


def unrelated(by_scene: Float[np.ndarray, " s"], *, one_material: bool = False) -> str | None:
    """A note where the scenes' correlations are no more than chance; None where they are, or nothing can be ranked (a
    simulator whose intensity is the same everywhere is no stranger), nor where surfaces of `one_material` are ranked
    by the angles at which they stand, unless they speak against it."""
    finite = by_scene[np.isfinite(by_scene)]
    # Fewer scenes cannot agree at this level, whatever they say.
    if 2.0 ** -len(finite) > RULES.agreement_level:
        return None
    chance = p_value(finite)
    if chance <= RULES.agreement_level or (one_material and p_value(-finite) > RULES.agreement_level):
        return None
    return (
        "the two sides' intensities have no relation beyond chance: surfaces that the simulator has brighter are not "
        f"brighter measured (rank correlation {finite.mean():+.2f} in the mean of {len(finite)} scenes, p {chance:.2g}"
        "). No effect on intensities is named; check that both folders hold the same streets, and intensities on both "
        "sides"
    )


def of_one_material(ev: Evidence) -> list[str]:
    """A note where the simulated intensities follow from range and angle of incidence alone, as Lambert's law on the
    measured ranges does: what it lacks can be asked, whatever surfaces are bright."""
    counts = np.asarray(ev.compared)
    if not counts.any():
        return []
    rays = {name: np.asarray(getattr(ev.rays, name))[counts] for name in ("range_m", "incidence_rad", "log_intensity")}
    intensity = np.exp(rays["log_intensity"].astype(np.float64))
    by_range = _quantile_bins(rays["range_m"])
    place = by_range * RULES.one_material_bins
    for k in np.unique(by_range):
        place[by_range == k] += _quantile_bins(rays["incidence_rad"][by_range == k])
    size = np.maximum(np.bincount(place), 1)
    left = intensity - (np.bincount(place, intensity) / size)[place]
    # Bins of few rays have means near these rays.
    free = len(place) - len(np.unique(place))
    total = float(np.var(intensity))
    if not total or free <= 0 or float(np.square(left).sum()) / free > RULES.one_material_share * total:
        return []
    return [
        "simulated intensities follow from range and angle of incidence alone, as if all were of one material: effects "
        "on intensity say what that law lacks, and what differs between surfaces counts as noise or as reflectances"
    ]


def _quantile_bins(values: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    edges = np.quantile(values, np.arange(1, RULES.one_material_bins) / RULES.one_material_bins)
    return np.searchsorted(edges, values)


def of_ranges(effect: Effect) -> bool:
    """Whether an effect can be told without intensities: it changes others, and of no surfaces that the simulator has
    bright."""
    return not effect.around_bright and ("intensity" not in effect.channels or "range" in effect.channels)
