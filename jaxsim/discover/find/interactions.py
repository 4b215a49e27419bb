"""Dependence on two covariates at once that neither shows alone: an effect may have no marginal at all.

A channel's residuals, less what an additive model of all covariates explains on scenes that it was not fitted to, are
held against products of two covariates' curves. The strongest pair must beat what the strongest of all pairs gains by
chance (`scenes.best_of_gains`), so that trying many pairs is paid for.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.find.additive import Additive
from jaxsim.discover.find.localise import COVARIATES, Place, curve_basis, values_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import best_of_gains

CROSSED = ("range", "incidence", "row", "azimuth", "class", "power", "intensity", "step side", "time", "speed")
"""Covariates of which pairs are tried; time since the first frame has too few values to be crossed with others."""


def interactions(
    rays: Any,
    residuals: Mapping[str, tuple[np.ndarray, np.ndarray]],
    scene: Int[np.ndarray, " b"],
    *,
    level: float = RULES.dependence_level,
) -> list[Place]:
    """Each channel's strongest pair, as a Place whose covariate is `A x B`, where its p-value is at most `level`.

    Arguments as `localise`. Fewer than `Rules.fewest_pair_scenes` decide nothing.
    """
    places = []
    scenes = np.unique(scene)
    for channel, (z, counts) in residuals.items():
        counts = _thinned(counts)
        if counts.sum() < RULES.fewest_residuals or len(scenes) < RULES.fewest_pair_scenes:
            continue
        index = np.searchsorted(scenes, np.broadcast_to(scene[:, None, None], counts.shape)[counts])
        if _effective(z[counts]) < RULES.fewest_effective:
            continue
        designs = {name: curve_basis(values_of(name, rays, counts), name) for name in COVARIATES}
        additive = Additive(z[counts].astype(np.float32), designs, index, scenes=len(scenes))
        rest = additive.z - additive.predicted(list(designs))
        curves = {name: _short(values_of(name, rays, counts), name) for name in CROSSED}
        pairs = list(combinations([name for name, curve in curves.items() if curve.shape[1] > 1], 2))
        gains = np.stack([_pair_gain(rest, curves[a], curves[b], index=index, scenes=len(scenes)) for a, b in pairs])
        best, p = best_of_gains(gains)
        if p <= level:
            share = float(2 * gains[best].sum() / (rest.astype(np.float64) ** 2).sum())
            scale = (residuals[channel][1].sum() / counts.sum()).item()
            places.append(Place(channel, " x ".join(pairs[best]), p, share, float(gains[best].sum() * scale)))
    return places


def _thinned(counts: Bool[np.ndarray, "b c r"]) -> Bool[np.ndarray, "b c r"]:
    """Every so manieth of the cells that count, `Rules.pair_residuals` at most."""
    cells = np.flatnonzero(counts)
    kept = np.zeros(counts.size, bool)
    kept[cells[:: max(1, -(-len(cells) // RULES.pair_residuals))]] = True
    return kept.reshape(counts.shape)


def _effective(z: Float[np.ndarray, " n"]) -> float:
    """How many equally large residuals have the weight of these (Kish 1965)."""
    squares = z.astype(np.float64) ** 2
    return float(squares.sum() ** 2 / max((squares**2).sum(), 1e-12))


def _short(x: np.ndarray, name: str) -> Float[np.ndarray, "n k"]:
    """A curve of few knots: a product of two has the product of their numbers. Only classes keep a column each."""
    return curve_basis(x, name if name == "class" else "", RULES.pair_knots)


def _pair_gain(
    rest: Float[np.ndarray, " n"],
    first: Float[np.ndarray, "n j"],
    second: Float[np.ndarray, "n k"],
    *,
    index: Int[np.ndarray, " n"],
    scenes: int,
) -> Float[np.ndarray, " s"]:
    """Held-out nats of each scene by the products of two curves."""
    products = (first[:, :, None] * second[:, None, :]).reshape(len(rest), -1)
    model = Additive(rest, {"pair": products}, index, scenes=scenes)
    return model.by_scene(np.zeros(len(rest)), model.predicted(["pair"]))[0]


def spelled(covariate: str, names: Mapping[str, str]) -> str:
    """A covariate, or a pair, in a verdict's words. (`speed x time` is a covariate of its own.)"""
    return names.get(covariate) or " x ".join(names.get(part, part) for part in covariate.split(" x "))
