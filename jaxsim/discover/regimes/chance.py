"""Whether an effect is stronger in some region by more than chance: exact tests over scenes, best of all regions.

Where regions are made of whole scenes, scenes are exchangeable if nothing divides them: their excesses are dealt out
anew. Where regions run through every scene (sectors), each scene's contrast is as likely as its negative: scenes change
signs. Either way the best of a question's regions is held against the best under each draw (max-T), which pays for
having looked at all; and false discoveries are kept rare over all questions by Benjamini and Hochberg (1995).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import false_discovery_control

from jaxsim.discover.regimes.questions import Question
from jaxsim.discover.regimes.sizes import Cells
from jaxsim.discover.scenes import chance_of, clipped, orders_of, signs_of


class Found(NamedTuple):
    """The region of a question in which an effect is most clearly stronger than outside."""

    question: Question
    k: int
    p_value: float


def ask(question: Question, of: Cells, unit: Int[np.ndarray, " b"]) -> Found:
    """The best region and how often chance makes some region of the question as good."""
    whole = question.between_units(unit)
    if whole is None:
        best, p = flipped(*_contrasts(question, of, unit))
    else:
        best, p = dealt(np.bincount(unit, of.excess.sum(1)), whole)
    return Found(question, best, p)


def _contrasts(
    question: Question, of: Cells, unit: Int[np.ndarray, " b"]
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, " k"]]:
    """Gives by how much each region's slope exceeds its share of each unit's, and the variance by the curvature."""
    units = int(unit.max()) + 1
    excess = np.bincount(unit, of.excess.sum(1), units)
    curvature = np.bincount(unit, of.curvature.sum(1), units)
    rows: list[Float[np.ndarray, " n"]] = []
    variance: list[float] = []
    for region in question.inside:
        here = np.bincount(unit, (of.excess * region).sum(1), units)
        weight = np.bincount(unit, (of.curvature * region).sum(1), units)
        # A unit that asks for more of the effect everywhere asks for no region.
        share = weight / curvature
        rows.append(here - share * excess)
        variance.append((weight * (1 - share)).sum())
    return np.stack(rows), np.maximum(np.array(variance), 1e-9)


def flipped(contrasts: Float[np.ndarray, "k n"], variance: Float[np.ndarray, " k"]) -> tuple[int, float]:
    """The region that units' contrasts speak for most, and how often some region's do when units change their signs;
    for the latter no unit counts for more than the third largest. The variances are those of the sums, and do not
    change with the signs."""
    scaled = contrasts / np.sqrt(variance)[:, None]
    best = int(scaled.sum(1).argmax())
    held = np.stack([clipped(one) for one in scaled])
    by_chance = (signs_of(contrasts.shape[1]) @ held.T).max(1)
    return best, float(np.mean(by_chance >= held[best].sum() - 1e-9))


def dealt(excess: Float[np.ndarray, " n"], whole: Bool[np.ndarray, "k n"]) -> tuple[int, float]:
    """The region whose units exceed the others most, and how often some region's do when the units' excesses are dealt
    out anew (`Rules.sign_draws` times)."""
    units = len(excess)
    off = clipped(excess - excess.mean())
    # Clipping leaves a mean, which regions of more units would gather.
    off = off - off.mean()
    count = whole.sum(1)
    # Drawn without replacement: a region of all units but one varies as little as that one.
    spread = np.sqrt(count * (units - count) / units)
    scaled = whole / spread[:, None]
    observed = scaled @ off
    best = int(observed.argmax())
    return best, chance_of((off[orders_of(units)] @ scaled.T).max(1), observed[best])


def false_discovery_rates(found: list[Found]) -> list[float]:
    """The q-value of each, over all questions that were asked."""
    return [float(q) for q in false_discovery_control([one.p_value for one in found])] if found else []
