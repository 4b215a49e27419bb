"""Drives that only their own readings tell apart: the effect is in some and not in others, and nothing else divides
them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from jaxsim.discover.regimes.chance import Found
from jaxsim.discover.regimes.questions import Facts, Question
from jaxsim.discover.regimes.sizes import Cells
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import chance_of, clipped, orders_of
from jaxsim.effects.region import Region


def by_own_size(of: Cells, facts: Facts) -> Found | None:
    """The scenes whose own sizes are large; `of` holds even and odd columns of each sector apart (2 a + parity).

    Scenes that differ by noise alone differ in both halves of their columns alike only by chance: the excesses of one
    half are dealt out anew. The division is the widest gap between sizes. None for a single drive.
    """
    few = RULES.regime_fewest_units
    if len(set(facts.names)) < 2 or facts.units < 2 * few:
        return None
    excess = _by_half(of.excess, facts)
    curvature = _by_half(of.curvature, facts)
    p = alike(excess[0], excess[1])
    size = excess.sum(0) / np.maximum(curvature.sum(0), 1e-9)
    order = np.argsort(-size)
    count = few + int(np.argmax(-np.diff(size[order])[few - 1 : facts.units - few]))
    inside = np.isin(np.arange(facts.units), order[:count])
    names = {n: facts.names[facts.frame[np.argmax(facts.unit == n)]] for n in range(facts.units)}
    region = Region(scenes=tuple(sorted(names[n] for n in np.flatnonzero(inside).tolist())))
    masks = inside[facts.unit][None, :, None]
    return Found(Question("scene", (region,), masks), 0, p)


def alike(first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"]) -> float:
    """How often units resemble themselves so well if the excesses of one half are dealt out anew; no unit counts for
    more than the third largest."""
    a = clipped(first - first.mean())
    b = clipped(second - second.mean())
    a = a - a.mean()
    return chance_of(b[orders_of(len(b))] @ a, a @ b)


def _by_half(part: np.ndarray, facts: Facts) -> np.ndarray:
    """(2, n): sums over each scene's even and odd columns."""
    return np.stack([np.bincount(facts.unit, part[:, half::2].sum(1), facts.units) for half in (0, 1)])
