"""Kinds of surfaces whose reflectance the simulator's table may have wrong: classes, or what stands in for them.

Frames without classes still show a few materials again and again: a floor that is darker than its table says is so in
every scene, and a wrong cosine, gamma or gain of the lower beams would explain it. So level ground and all else are
told apart by their planes, and each by how bright the simulator has it: a free curve of the albedo, as classes have a
free level each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.model.cast import RayIndex
from jaxsim.discover.model.noise_levels import STEEPEST_COSINE
from jaxsim.effects.learned import hats
from jaxsim.effects.rays import FLOOR, Scan

LEVEL_RAD = 0.15
"""Planes tilted by less than this are level ground."""
LEAST_DOWN_RAD = np.deg2rad(1.0)
"""Rays that look down by less tell no ground from walls."""
QUANTILES = (0.05, 0.35, 0.65, 0.95)
"""Quantiles of ln albedo: knots of the free curve."""
LEAST_APART = 0.1
"""Nats between knots, at least; where all albedos are alike one knot is left."""


class Kinds(NamedTuple):
    """How much of each kind a ray's surface is."""

    names: tuple[str, ...]
    share: Float[np.ndarray, "b c r k"]
    """0..1; the kinds of a ray sum to 1."""


def kinds_of(scan: Scan, index: RayIndex) -> Kinds:
    """The kinds of the chosen rays' surfaces: their classes, or ground and others by albedo where all are of one."""
    semantic = np.asarray(scan.semantic)
    classes = np.unique(semantic[index])
    if len(np.unique(semantic)) > 1:
        of_class = [(semantic[index] == c).astype(np.float32) for c in classes]
        return Kinds(tuple(f"class {c}" for c in classes), np.stack(of_class, axis=-1))
    albedo = _log_albedo(scan)
    ground = _ground(scan)
    names: list[str] = []
    shares: list[np.ndarray] = []
    for name, kind in (("ground", ground), ("other surfaces", ~ground)):
        of_kind = kind & np.asarray(scan.hit)
        if of_kind.any():
            knots = _knots(albedo[of_kind])
            names += [f"{name} of albedo {np.exp(knot):.2g}" for knot in knots]
            # Every kind has columns of its own: a knot of the ground's curve says nothing of walls.
            shares.append(np.where(kind[index][..., None], hats(albedo[index], knots), 0.0))
    return Kinds(tuple(names), np.concatenate(shares, axis=-1).astype(np.float32))


def _log_albedo(scan: Scan) -> Float[np.ndarray, "f r n"]:
    cosine = np.maximum(np.cos(np.asarray(scan.incidence_rad, np.float64)), STEEPEST_COSINE)
    return np.log(np.maximum(np.asarray(scan.intensity, np.float64), FLOOR) / cosine)


def _ground(scan: Scan) -> Bool[np.ndarray, "f r n"]:
    """Rays that meet their plane as they would meet level ground."""
    down = -np.asarray(scan.grid.elevation_rad, np.float64)[None, :, None]
    level = np.abs(np.asarray(scan.incidence_rad) - (np.pi / 2 - down)) < LEVEL_RAD
    return level & (down > LEAST_DOWN_RAD)


def _knots(albedo: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
    knots: list[float] = []
    for knot in np.quantile(albedo, QUANTILES):
        if not knots or knot - knots[-1] > LEAST_APART:
            knots.append(float(knot))
    return np.array(knots)
