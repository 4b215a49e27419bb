"""Kinds of surfaces: those whose reflectance the simulator's table may have wrong.

They are classes, or what stands in for them. Frames without classes still show a few materials again and again: a floor
that is darker than its table says is so in every scene, and a wrong cosine, gamma or gain of the lower beams would
explain it. So level ground and all else are told apart by their planes, and each by how bright the simulator has it: a
free curve of the albedo, as classes have a free level each. What is no ground also has one along its height: the lower
half of a wall may be of another material in every scene, and rows and ranges of the frames follow heights. A simulator
that gives each material one intensity, at any angle, shows its table as it is: each of these is a kind.

Letters: b blocks, c columns, r rows of the rays that are looked at; f frames of n columns; k kinds; l intensities of a
table.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.cast import RayIndex
from jaxsim.discover.model.noise_levels import MOST_VALUES, cosine_of
from jaxsim.discover.rules import RULES
from jaxsim.effects.learned import hats
from jaxsim.effects.rays import FLOOR, Scan

KNOT_QUANTILES = (0.05, 0.35, 0.65, 0.95)
"""Quantiles of ln albedo: knots of the free curve."""
HEIGHT_QUANTILES = (0.02, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 0.98)
"""Quantiles of the height of what is no ground: knots of that curve."""
BARE = ("ground", "other surfaces")
"""Names of the kinds where all surfaces are of one class."""


class Kinds(NamedTuple):
    """How much of each kind a ray's surface is."""

    names: tuple[str, ...]
    share: Float[np.ndarray, "b c r k"]
    """0..1; the kinds of a ray sum to 1, and beside them, where no class is told, its heights to 1 or 0."""


def kinds_of(scan: Scan, index: RayIndex) -> Kinds:
    """The kinds of the chosen rays' surfaces: their classes, or ground and others where all are of one; each by its
    intensities where these are few, for then they are a table's, else what has no class by albedo and height."""
    semantic = np.asarray(scan.semantic)
    classes = np.unique(semantic)
    hit = np.asarray(scan.hit)
    few = slice(None, None, max(1, hit.sum() // MOST_VALUES))
    levels = few_levels(np.asarray(scan.intensity)[hit][few], np.asarray(scan.incidence_rad)[hit][few])
    if len(classes) > 1 or levels is not None:
        kind = semantic if len(classes) > 1 else np.where(_ground(scan), 0, 1)
        names = {int(c): f"class {c}" if len(classes) > 1 else BARE[c] for c in np.unique(kind[index])}
        return _by_level(names, kind[index], intensity=np.asarray(scan.intensity)[index], levels=levels)
    albedo = _log_albedo(scan)
    ground = _ground(scan)
    labels: list[str] = []
    shares: list[np.ndarray] = []
    for name, kind in zip(BARE, (ground, ~ground), strict=True):
        of_kind = kind & np.asarray(scan.hit)
        if of_kind.any():
            knots = _knots(albedo[of_kind], KNOT_QUANTILES, apart=RULES.albedo_apart)
            labels += [f"{name} of albedo {np.exp(knot):.2g}" for knot in knots]
            # Every kind has columns of its own: a knot of the ground's curve says nothing of walls.
            shares.append(np.where(kind[index][..., None], hats(albedo[index], knots), 0.0))
    standing = hit & ~ground
    height_m = np.asarray(scan.range_m, np.float64) * np.sin(_elevation(scan))
    knots = _knots(height_m[standing], HEIGHT_QUANTILES, apart=RULES.heights_apart_m)
    # At one height there is nothing to be told from it.
    if len(knots) > 1:
        labels += [f"{BARE[1]} at {knot:.2g} m" for knot in knots]
        shares.append(np.where(standing[index][..., None], hats(height_m[index], knots), 0.0))
    return Kinds(tuple(labels), np.concatenate(shares, axis=-1).astype(np.float32))


def _by_level(
    names: dict[int, str],
    kind: Int[np.ndarray, "b c r"],
    *,
    intensity: Float[np.ndarray, "b c r"],
    levels: Float[np.ndarray, " l"] | None,
) -> Kinds:
    """Kinds with a column each; where there are `levels`, one for each that a kind has."""
    labels: list[str] = []
    shares: list[np.ndarray] = []
    for number, name in names.items():
        of_kind = kind == number
        if levels is None:
            labels.append(name)
            shares.append(of_kind)
            continue
        at = np.abs(intensity[..., None] - levels).argmin(-1)
        for level in np.unique(at[of_kind]):
            labels.append(f"{name} of intensity {levels[level]:.3g}")
            shares.append(of_kind & (at == level))
    return Kinds(tuple(labels), np.stack(shares, axis=-1).astype(np.float32))


def few_levels(
    intensity: Float[np.ndarray, " n"], incidence_rad: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " l"] | None:
    """The intensities of a simulator that gives each material one, whatever the angle; None where nearly all rays do
    not read one of a few, or these are the steps of a rounding, or each is one angle's."""
    values, level, count = np.unique(
        np.asarray(intensity, np.float32).round(5), return_inverse=True, return_counts=True
    )
    often = np.sort(np.argsort(-count, kind="stable")[: RULES.few_values])
    if not len(values) or count[often].sum() < RULES.lattice_share * len(intensity):
        return None
    common = values[often]
    gaps = np.diff(common)
    fine = len(gaps) > 0 and gaps.min() <= RULES.coarsest_step
    rounded = fine and len(common) * gaps.min() > RULES.filled_lattice * np.ptp(common)
    # Of one material that shines as Lambert's law has it, each row of a road reads one value.
    mean = np.bincount(level, incidence_rad) / count
    within = np.square(incidence_rad - mean[level]).mean()
    return None if rounded or within < RULES.one_angle_share * np.var(incidence_rad) else common


def _log_albedo(scan: Scan) -> Float[np.ndarray, "f r n"]:
    return np.log(np.maximum(np.asarray(scan.intensity, np.float64), FLOOR) / cosine_of(scan))


def _ground(scan: Scan) -> Bool[np.ndarray, "f r n"]:
    """Rays that meet their plane as they would meet level ground."""
    down = -_elevation(scan)
    level = np.abs(np.asarray(scan.incidence_rad) - (np.pi / 2 - down)) < RULES.level_ground_rad
    return level & (down > RULES.least_down_rad)


def _elevation(scan: Scan) -> Float[np.ndarray, "1 r 1"]:
    """Elevation of each row, rad."""
    return np.asarray(scan.grid.elevation_rad, np.float64)[None, :, None]


def _knots(values: Float[np.ndarray, " n"], quantiles: Sequence[float], *, apart: float) -> Float[np.ndarray, " k"]:
    """These quantiles, without those that lie nearer to the one before than `apart`; none of no values."""
    knots: list[float] = []
    for knot in np.quantile(values, quantiles) if len(values) else ():
        if not knots or knot - knots[-1] > apart:
            knots.append(float(knot))
    return np.array(knots)
