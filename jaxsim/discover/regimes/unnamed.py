"""Effects that scenes dispute because only some show them: candidates that a division makes clear.

An effect in half of the scenes gains there and loses elsewhere, so that naming over all scenes may miss it. But the
scenes on which it gains lie on one side of a moment, or share a tag. Rates are what each scene says, unseen by the fit,
of the direction of a candidate (`Candidate.slope`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.regimes.chance import Found
from jaxsim.discover.regimes.questions import Facts, Question
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import chance_of, clipped, orders_of
from jaxsim.effects.region import WHOLE


class Disputed(NamedTuple):
    """A region that divides the scenes of some candidates."""

    found: Found
    candidates: tuple[Candidate, ...]
    """Those that it makes clearest first."""
    exists: bool
    """Whether some candidate's scenes agree better in some region than they would if there were nothing at all."""


def disputed(candidates: Sequence[Candidate], asked: Sequence[Question], facts: Facts) -> list[Disputed]:
    """For each question whose regions are made of whole scenes, the best region over all candidates."""
    tried = [one for one in candidates if one.effect.plain_name not in WHOLE and one.slope.any()]
    if not tried:
        return []
    rates = np.stack([clipped(one.slope) for one in tried])
    result = []
    for question in asked:
        whole = question.between_units(facts.unit)
        if whole is None:
            continue
        k, strength, p = divided(rates, whole)
        order = [tried[c] for c in np.argsort(-strength[:, k])]
        sure = p <= RULES.regime_level and existing(rates, whole) <= RULES.agreement_level
        result.append(Disputed(Found(question, k, p), tuple(order), sure))
    return result


def divided(
    rates: Float[np.ndarray, "c n"], whole: Bool[np.ndarray, "k n"]
) -> tuple[int, Float[np.ndarray, "c k"], float]:
    """The region that divides some candidate's scenes most, how clearly each does each candidate's, and how often
    scenes that are dealt out anew, all candidates alike, are divided as clearly."""
    off = rates - rates.mean(1, keepdims=True)
    off = off / (off.std(1, keepdims=True) + 1e-12)
    units = rates.shape[1]
    count = whole.sum(1)
    scaled = (whole / np.sqrt(count * (units - count) / units)[:, None]).T
    strength = off @ scaled
    by_chance = np.array([(off[:, order] @ scaled).max() for order in orders_of(units)])
    return int(strength.max(0).argmax()), strength, chance_of(by_chance, strength.max())


def existing(rates: Float[np.ndarray, "c n"], whole: Bool[np.ndarray, "k n"]) -> float:
    """How often scenes without anything in them, which may change places and signs, agree so well in some region."""
    scaled = (whole / np.sqrt(whole.sum(1))[:, None]).T
    unit = rates / (np.sqrt((rates**2).sum(1, keepdims=True)) + 1e-12)
    rng = np.random.default_rng(1)
    units = rates.shape[1]
    by_chance = [(unit[:, order] * rng.choice([-1.0, 1.0], units) @ scaled).max() for order in orders_of(units)]
    return chance_of(np.array(by_chance), (unit @ scaled).max())
