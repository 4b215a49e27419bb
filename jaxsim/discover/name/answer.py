"""Which of the three answers it is: named, none, or not in the catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jaxsim.discover.find.localise import Place, localise
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.lattice import FINEST
from jaxsim.discover.model.likelihood import CHANNELS
from jaxsim.discover.model.residuals import standardised
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import ALIKE, Choice, with_steps
from jaxsim.discover.name.unexplained import agreed, describe, free_curves
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.discover.verdict import Unexplained

BETTER = 1.1
"""A free curve must gain this many times what the named effects of its channel gain together to say that the effect is
not in the catalogue."""
SURELY = 10.0
"""... and so many nats more."""


def decide(
    null: Problem, choice: Choice, places: list[Place], everyone: np.ndarray, unit: np.ndarray
) -> tuple[str, Choice, Unexplained | None]:
    """The answer, what is named in it, and what a free curve still finds. `places` are the null's dependences, `unit`
    the scene of each block.

    Where a free curve explains clearly more of its channel than the effects that were chosen for it, these are not
    named: what is there is not in the catalogue. Effects of other channels stay.
    """
    curves = [(place, curve) for place, curve in free_curves(null, places) if agreed(curve, choice.bars.free)]
    outside = curves[0] if curves and outdone(choice, *curves[0]) else None
    if outside:
        kept = tuple(step for step in choice.steps if outside[0].channel not in step.chosen.effect.channels)
        if not kept:
            empty = Choice((), null, choice.steps[0].ranking if choice.steps else choice.last, choice.bars)
            return "not_in_catalogue", empty, describe(null, *outside)
        if len(kept) < len(choice.steps):
            choice = replace(choice, steps=kept, problem=with_steps(null, kept))
    if not choice.steps:
        return "none", choice, None
    after = localise(*standardised(choice.problem, everyone), unit)
    left = [(place, curve) for place, curve in free_curves(choice.problem, after) if agreed(curve, choice.bars.free)]
    return "named", choice, describe(choice.problem, *left[0]) if left else None


def outdone(choice: Choice, place: Place, curve: Candidate) -> bool:
    """Whether a free curve gains clearly more in its own channel (an effect may show in others besides) than the
    effects that were chosen. What a lattice of readings gains does not count: it is no dependence on anything."""
    k = CHANNELS.index(place.channel)
    free = curve.gain[:, k]
    steps = [step for step in choice.steps if step.chosen.effect.name not in FINEST]
    named = sum((step.chosen.gain[:, k] for step in steps), np.zeros(len(free)))
    much = clipped(free).sum() > BETTER * max(clipped(named).sum(), 0.0) + SURELY
    return bool(much and (not steps or p_value(clipped(free - named)) <= ALIKE))
