"""The whole catalogue, each effect fitted and judged on scenes that its fit has not seen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.fit import CHANNELS, Fit, Problem, channels_of, fit, partway
from jaxsim.discover.model.lattice import FINEST
from jaxsim.discover.model.rounding import rounded, rounding_gain
from jaxsim.discover.name.beams import by_beam, smooth_score
from jaxsim.discover.name.starts import hints
from jaxsim.discover.scenes import AGREE, clipped, folds, p_value
from jaxsim.effects import Effect

THREADS = 2
PART = 0.25
"""Of the way from the null to a fit at which units are asked whether they agree on its direction."""
SUDDEN = 12.0
"""Nats that each of AGREE units must gain, and the others next to nothing lose, to pass without the test over units: of
a rare event (lost packets) most scenes say nothing."""


@dataclass(frozen=True)
class Candidate:
    """An effect and what it gained on held-out units."""

    effect: Effect
    gain: Float[np.ndarray, "u 3"]
    """Log-likelihood over the null, nats, by unit and channel."""
    fits: tuple[Fit, ...]
    """One a fold."""
    slope: Float[np.ndarray, " u"]
    """Gain by unit of the first PART of the way to each fit: what the units say of its direction."""
    own: Float[np.ndarray, " u"] | None = None
    """Of an effect with a number for each beam: gain by unit over the same effect with these numbers made smooth along
    the rows. What is smooth may be what the rows see, not what the beams do."""
    inside: float = 0.0
    """Log-likelihood over the null on the very units that were fitted, nats, mean of the folds: no evidence, but what
    a choice without held-out units would go by."""

    @property
    def by_unit(self) -> Float[np.ndarray, " u"]:
        return self.gain.sum(-1)

    @property
    def chance(self) -> float:
        """Probability that units agree so well by chance, on the fit or on its direction (the better of two tests)."""
        return min(1.0, 2 * min(p_value(clipped(self.by_unit)), p_value(clipped(self.slope))))

    @property
    def sudden(self) -> bool:
        """Whether few units gain so much, and the others lose so little, that no test over units is needed."""
        gain = self.by_unit
        lost = -gain[gain < 0].sum()
        return bool((gain > SUDDEN).sum() >= AGREE and lost < 0.05 * gain[gain > 0].sum())

    @property
    def total(self) -> float:
        return float(clipped(self.by_unit).sum())


def survey(problem: Problem, effects: Iterable[Effect], *, null: Sequence[Fit] | None = None) -> list[Candidate]:
    """Every effect fitted on each fold's scenes and scored on the others; largest gain first.

    `null` saves its fits where they are known.
    """
    unit = np.asarray(problem.ev.unit)
    groups, null = folds(unit), null or problem.null_fits
    problems = [replace(problem, noise=base.noise) for base in null]

    steps, more_starts = rounded(problem.ev), hints(problem)
    effects = [effect for effect in effects if effect.name not in FINEST or effect.name in steps]

    def one(effect: Effect) -> Candidate:
        used = [CHANNELS.index(name) for name in channels_of(effect)]
        gain, slope = np.zeros((problem.ev.units, 3)), np.zeros(problem.ev.units)
        own = np.zeros(problem.ev.units) if by_beam(effect) else None
        fits, inside = [], []
        step = steps.get(effect.name)
        at = None if step is None else ({next(iter(effect.parameters)): step},)
        starts = at or ({}, *effect.starts, *more_starts.get(effect.name, ()))
        for fitted, base, start in zip(groups, null, problems, strict=True):
            found = fit(effect, start, fitted, starts=starts, fixed=at is not None)
            more = np.zeros((len(unit), 3))
            more[:, used] = (found.score - base.score)[:, used]
            if step is not None:
                more += rounding_gain(problem.ev, {effect.name: step})
            inside.append(more[fitted > 0].sum())
            more[fitted > 0] = 0
            begun = more if at else np.zeros((len(unit), 3))
            if not at:
                begun[:, used] = (partway(effect, start, fitted, fit=found, share=PART) - base.score)[:, used]
                begun[fitted > 0] = 0
            slope += np.bincount(unit, begun.sum(-1), problem.ev.units)
            if own is not None:
                rough = (found.score - smooth_score(effect, start, fitted, found))[:, used].sum(-1)
                own += np.bincount(unit, np.where(fitted > 0, 0, rough), problem.ev.units)
            gain += np.stack([np.bincount(unit, more[:, k], problem.ev.units) for k in range(3)], axis=-1)
            fits.append(found)
        seen = np.unique(unit)
        beams = None if own is None else own[seen]
        return Candidate(effect, gain[seen], tuple(fits), slope[seen], beams, float(np.mean(inside)))

    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(one, effects))
    return sorted(found, key=lambda candidate: -candidate.total)
