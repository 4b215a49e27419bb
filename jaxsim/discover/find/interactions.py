"""Dependence on two covariates at once that neither shows alone: an effect may have no marginal at all.

A channel's residuals, less what an additive model of all covariates explains on scenes that it was not fitted to, are
held against products of two covariates' curves. The strongest pair must beat what the strongest of all pairs gains by
chance (Westfall & Young 1993, max-T, by signs over scenes), so that trying many pairs is paid for.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.find.additive import Additive
from jaxsim.discover.find.localise import COVARIATES, Place, curve_basis, values_of

CROSSED = ("range", "incidence", "row", "azimuth", "class", "power", "intensity", "step side", "time", "speed")
"""Covariates of which pairs are tried; time since the first frame has too few values to be crossed with others."""
KNOTS = 5
"""Of each covariate's curve within a pair; rows are taken as a length here, for a number each would be too many."""
MOST = 30_000
"""Residuals looked at, evenly spread: more cost time and hardly change a pair's rank."""
FEWEST = 100.0
"""Residuals, as `_effective` counts them, from which a channel is looked at: a handful of lost rays tells nothing."""
FLIPS = 4096


def interactions(
    rays: Any,
    residuals: Mapping[str, tuple[np.ndarray, np.ndarray]],
    unit: Int[np.ndarray, " b"],
    *,
    level: float,
) -> list[Place]:
    """Each channel's strongest pair, as a Place whose covariate is `A x B`, where its p-value is at most `level`.

    Arguments as `localise`. Fewer than six units decide nothing.
    """
    places = []
    units = np.unique(unit)
    for channel, (z, counts) in residuals.items():
        counts = _thinned(counts)
        if counts.sum() < 100 or len(units) < 6:
            continue
        place = np.searchsorted(units, np.broadcast_to(unit[:, None, None], counts.shape)[counts])
        if _effective(z[counts]) < FEWEST:
            continue
        left = _unexplained(z[counts].astype(np.float32), rays, counts, place, len(units))
        curves = {name: _short(values_of(name, rays, counts), name) for name in CROSSED}
        pairs = list(combinations([name for name, curve in curves.items() if curve.shape[1] > 1], 2))
        gains = np.stack([_pair_gain(left, curves[a], curves[b], place, len(units)) for a, b in pairs])
        best, p = _strongest(gains)
        if p <= level:
            share = float(2 * gains[best].sum() / (left.astype(np.float64) ** 2).sum())
            scale = (residuals[channel][1].sum() / counts.sum()).item()
            places.append(Place(channel, " x ".join(pairs[best]), p, share, float(gains[best].sum() * scale)))
    return places


def _thinned(counts: np.ndarray) -> np.ndarray:
    """Every so manieth of the cells that count."""
    cells = np.flatnonzero(counts)
    kept = np.zeros(counts.size, bool)
    kept[cells[:: max(1, -(-len(cells) // MOST))]] = True
    return kept.reshape(counts.shape)


def _effective(z: np.ndarray) -> float:
    """How many equally large residuals have the weight of these (Kish 1965)."""
    squares = z.astype(np.float64) ** 2
    return float(squares.sum() ** 2 / max((squares**2).sum(), 1e-12))


def _short(x: np.ndarray, name: str) -> Float[np.ndarray, "n k"]:
    return curve_basis(x, name if name == "class" else "", KNOTS)


def _unexplained(z: np.ndarray, rays: Any, counts: np.ndarray, place: np.ndarray, units: int) -> np.ndarray:
    """Residuals less the additive model of all covariates, each fold's fitted to the others."""
    designs = {name: curve_basis(values_of(name, rays, counts), name) for name in COVARIATES}
    return z - Additive(z, designs, place, units).predicted(list(designs))


def _pair_gain(left: np.ndarray, a: np.ndarray, b: np.ndarray, place: np.ndarray, units: int) -> np.ndarray:
    """Held-out nats of each unit by the products of two curves."""
    model = Additive(left, {"pair": (a[:, :, None] * b[:, None, :]).reshape(len(left), -1)}, place, units)
    return model.by_unit(np.zeros(len(left)), model.predicted(["pair"]))[0]


def _strongest(gains: Float[np.ndarray, "p u"]) -> tuple[int, float]:
    """The pair whose units agree most that it gains, and how often chance makes some pair's agree as much.

    By chance: units deviate from each pair's mean gain, taken as 0, at random signs. (A pair that says nothing gains
    less than 0, for its curves cost; so this errs to the safe side.)
    """
    off = gains - gains.mean(1, keepdims=True)
    spread = np.sqrt((off**2).sum(1)) + 1e-9
    agreement = gains.sum(1) / spread
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (FLIPS, gains.shape[1]))
    by_chance = (signs @ (off / spread[:, None]).T).max(1)
    best = int(agreement.argmax())
    return best, float((1 + np.sum(by_chance >= agreement[best])) / (1 + FLIPS))


def spelled(covariate: str, names: Mapping[str, str]) -> str:
    """A covariate, or a pair, in a verdict's words. (`speed x time` is a covariate of its own.)"""
    return names.get(covariate) or " x ".join(names.get(part, part) for part in covariate.split(" x "))
