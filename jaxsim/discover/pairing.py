"""Whether frames of the same name show the same street: without that a comparison means nothing.

A pair agrees on a ray where both sides return within 0.5 m or 5 % of each other. Every effect of the catalogue leaves
most rays so, but for rain and fog, whose returns all lie before the surface: a ray that goes on beyond the simulated
surface is another matter. Of frames of other streets the road still agrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import PolarImage

NEAR_M, NEAR_SHARE = 0.5, 0.05
"""A reading agrees with the simulated one within the larger of the two (the share is of the range)."""
AGREE = 0.75
"""Share of rays that agree in a frame, at least: effects of the catalogue leave nearly all, in another street little
more than the road agrees (tests/discover/test_pairing.py)."""
NOT_BEYOND = 0.8
"""The same share of the rays that agree or go beyond, at least: clutter before the surface does not count."""
OVERLAP = 0.05
"""Rays that return on both sides, of those of the poorer side, at least."""
STEADY = 0.05
"""Median absolute deviation of ln(measured / simulated range) up to which the two differ by a factor."""
FACTOR = 1.1
"""From which on it is one of units: the catalogue's range_scale ends at 1.02."""
BETTER = 0.1
"""By how much more of its rays another frame must agree to be the true partner."""
RAYS, OTHERS = 2000, 64
"""Looked at in each frame; and other frames with which each is compared."""


class Agreement(NamedTuple):
    """Of a frame's pair, or of many: shares of the rays that return on both sides."""

    near: Float[np.ndarray, "*n"]
    beyond: Float[np.ndarray, "*n"]
    """Measured clearly behind the simulated surface."""


def agreement(
    simulated_m: Float[np.ndarray, "*n rays"],
    measured_m: Float[np.ndarray, "*n rays"],
    both: Bool[np.ndarray, "*n rays"],
) -> Agreement:
    """How far two sides' ranges agree where `both` return; 0 where no ray does."""
    off = measured_m - simulated_m
    limit = np.maximum(NEAR_M, NEAR_SHARE * simulated_m)
    count = np.maximum(both.sum(-1), 1)
    near, beyond = (np.sum(both & there, -1) / count for there in (np.abs(off) < limit, off >= limit))
    return Agreement(near, beyond)


def check_pairs(names: Sequence[str], simulated: Sequence[PolarImage], measured: Sequence[PolarImage]) -> None:
    """Raises ValueError where frames of the same name cannot show the same street through the same sensor: ranges
    that differ by a factor, hardly a common return, too few rays that agree, or partners that fit each other's
    partner better."""
    stride = max(1, simulated[0].range_m.size // RAYS)
    (ours, hit), (theirs, back) = (
        (
            np.stack([np.asarray(image.range_m, np.float32).ravel()[::stride] for image in side]),
            np.stack([np.asarray(image.valid).ravel()[::stride] for image in side]),
        )
        for side in (simulated, measured)
    )
    both = hit & back & (ours > 0) & (theirs > 0)
    poorer = np.minimum(hit.sum(1), back.sum(1))
    apart = both.sum(1) < OVERLAP * poorer
    if apart.mean() > 0.5:
        k = int(np.argmax(apart))
        raise ValueError(
            f"discover: {names[k]} has {hit[k].sum()} returns simulated and {back[k].sum()} measured of {hit[k].size}, "
            f"but only {both[k].sum()} on the same rays; {_advice()}"
        )
    log_ratio = np.log(theirs[both] / ours[both])
    middle = float(np.median(log_ratio))
    if abs(middle) > np.log(FACTOR) and float(np.median(np.abs(log_ratio - middle))) < STEADY:
        raise ValueError(
            f"discover: measured ranges are {np.exp(middle):.4g} times the simulated ones on the same rays; ranges are "
            "metres on both sides: correct the side that is in other units"
        )
    own = agreement(ours, theirs, both)
    near, firm = (float(np.median(x)) for x in (own.near, own.near / np.maximum(own.near + own.beyond, 1e-9)))
    if near < AGREE and firm < NOT_BEYOND:
        k = int(np.argsort(own.near)[len(names) // 2])
        raise ValueError(
            f"discover: frames of the same name do not show the same street: ranges agree (within {NEAR_M:g} m or "
            f"{100 * NEAR_SHARE:g} %) on {100 * own.near[k]:.0f} % of the rays that return on both sides of {names[k]} "
            f"and of half the frames; {_advice()}"
        )
    _check_partners(names, ours, theirs, hit, back, own.near)


def _check_partners(
    names: Sequence[str],
    ours: Float[np.ndarray, "f rays"],
    theirs: Float[np.ndarray, "f rays"],
    hit: Bool[np.ndarray, "f rays"],
    back: Bool[np.ndarray, "f rays"],
    own: Float[np.ndarray, " f"],
) -> None:
    """Raises ValueError where most measured frames fit another simulated frame clearly better than their own."""
    others = np.unique(np.linspace(0, len(names) - 1, OTHERS).round().astype(int))
    best = np.zeros(len(names), int)
    share = np.zeros(len(names))
    for k in range(len(names)):
        each = agreement(ours[others], np.broadcast_to(theirs[k], ours[others].shape), hit[others] & back[k][None])
        best[k], share[k] = others[np.argmax(each.near)], each.near.max()
    wrong = share > own + BETTER
    if wrong.mean() > 0.5:
        k = int(np.argmax(share - own))
        raise ValueError(
            f"discover: names pair the wrong frames: measured {names[k]} agrees with simulated {names[best[k]]} on "
            f"{100 * share[k]:.0f} % of the rays, with simulated {names[k]} on {100 * own[k]:.0f} %, and so for "
            f"{wrong.sum()} of {len(names)} frames; give the files of one moment the same name on both sides"
        )


def _advice() -> str:
    return (
        "check that names pair the same moments, that both sides use the same axes and mounting (a few degrees off are "
        "too many), or, if they show different streets, use --unpaired"
    )
