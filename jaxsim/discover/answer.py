"""Which of the three answers it is: named, none, or not in the catalogue."""

from __future__ import annotations

import numpy as np

from jaxsim.discover.fit import Problem
from jaxsim.discover.likelihood import CHANNELS
from jaxsim.discover.localise import Place, localise, p_value
from jaxsim.discover.name import ALIKE, Choice
from jaxsim.discover.residuals import standardised
from jaxsim.discover.survey import clipped
from jaxsim.discover.unexplained import agreed, describe, free_curves
from jaxsim.discover.verdict import Unexplained

BETTER = 1.1
"""A free curve must gain this many times what the named effects of its channel gain together to say that the effect is
not in the catalogue."""
SURELY = 10.0
"""... and so many nats more."""


def decide(
    null: Problem, choice: Choice, places: list[Place], everyone: np.ndarray, unit: np.ndarray
) -> tuple[str, Choice, Unexplained | None]:
    """The answer; what is named in it, nothing where free curves explain clearly more than what was chosen; and what a
    free curve still finds. `places` are the null's dependences, `unit` the scene of each block."""
    curves = [(place, curve) for place, curve in free_curves(null, places) if agreed(curve)]
    if curves:
        place, curve = curves[0]
        # In the curve's own channel: an effect may show in others besides.
        k = CHANNELS.index(place.channel)
        free = curve.gain[:, k]
        named = sum((step.chosen.gain[:, k] for step in choice.steps), np.zeros(len(free)))
        surplus = clipped(free - named)
        much = clipped(free).sum() > BETTER * max(clipped(named).sum(), 0.0) + SURELY
        if much and (not choice.steps or p_value(surplus) <= ALIKE):
            empty = Choice((), null, choice.steps[0].ranking if choice.steps else choice.last)
            return "not_in_catalogue", empty, describe(null, place, curve)
    if not choice.steps:
        return "none", choice, None
    after = localise(*standardised(choice.problem, everyone), unit)
    left = [(place, curve) for place, curve in free_curves(choice.problem, after) if agreed(curve)]
    return "named", choice, describe(choice.problem, *left[0]) if left else None
