"""How large a pattern is, with its 90 % interval: what scenes show of it over what they would of one of height 1."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from jaxsim.discover.repeats.chance import alike
from jaxsim.discover.repeats.maps import Maps
from jaxsim.discover.repeats.scales import Scale
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import jackknife_half_width
from jaxsim.discover.verdict import Interval

UNITS = {"intensity": "nats", "range": "m", "drop": "share of rays"}


def height_of(shows: Float[np.ndarray, " n"], answers: Float[np.ndarray, " n"], channel: str) -> Interval:
    """What scenes show of a pattern over what they would of one of height 1."""
    without = (shows.sum() - shows) / np.maximum(answers.sum() - answers, 1e-12)
    return _interval(shows.sum() / max(answers.sum(), 1e-12), without, channel)


def common_size(maps: Maps, scale: Scale, channel: str) -> Interval:
    """Root mean square of the pattern that scenes have in common: what products of any two scenes' maps add up to, over
    what they would if a pattern of random signs and height 1 were all that is there."""
    grid = maps.total.shape[1:]
    shape = [count if name in scale.along else 1 for count, name in zip(grid, ("row", "column"), strict=True)]
    made = np.broadcast_to(np.random.default_rng(0).choice([-1.0, 1.0], shape), grid).copy()
    shows = alike(scale.sums(maps.total)).sum(1)
    answers = alike(scale.sums(maps.centred(maps.left(made)))).sum(1)
    # A product belongs to both of its scenes: without one of them, what it shares with all others goes twice.
    without = (shows.sum() - 2 * shows) / np.maximum(answers.sum() - 2 * answers, 1e-12)
    square = shows.sum() / max(answers.sum(), 1e-12)
    return _interval(np.sqrt(max(square, 0)), np.sqrt(np.maximum(without, 0)), channel)


def _interval(value: float, without: Float[np.ndarray, " n"], channel: str) -> Interval:
    """The interval by what the value becomes `without` each of the scenes, widened as parameters' intervals are."""
    half = RULES.interval_widening * jackknife_half_width(without)
    return Interval(float(value), float(value) - half, float(value) + half, UNITS[channel])
