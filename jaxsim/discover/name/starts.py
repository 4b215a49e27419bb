"""Values read off the measurement: where a fit from elsewhere would feel no pull, it begins here.

Borders between all and nothing (a ceiling, a gate, a hidden sector) have no slope away from themselves.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem

PILE = 0.005
"""Readings within this share of the largest are piled up there ..."""
PILED = 0.002
"""... if they are at least this share of all."""
GATED = 20.0
"""Nats by which a border between lost and returned must be likelier than none."""
PAST_M = (0.02, 0.05, 0.1)
"""How far past such a border a gate may lie."""
BIN_RAD = np.deg2rad(1.0)
"""Width of the bins of azimuth in which a hidden sector is looked for."""
HIDDEN = 0.8
"""Share lost above which a bin of azimuth counts as hidden."""

Start = dict[str, float]


def starts_of(problem: Problem) -> dict[str, tuple[Start, ...]]:
    """Further starts of a fit, by effect."""
    ev = jax.tree.map(np.asarray, problem.ev)
    return {name: starts for name, read in READ.items() if (starts := read(ev))}


def _ceiling(ev: Evidence) -> tuple[Start, ...]:
    values = ev.intensity[ev.returned]
    if not len(values):
        return ()
    top = float(values.max())
    # A ceiling clips: readings pile up right below it.
    piled = np.mean(values > (1 - PILE) * top) >= PILED
    return ({"ceiling": top},) if piled and top < 1 else ()


def _gate(ev: Evidence) -> tuple[Start, ...]:
    smooth = ev.rays.hit & ~ev.edge
    r = ev.rays.range_m[smooth]
    lost = ~ev.returned[smooth]
    starts = []
    for name, sign in (("minimum_m", 1.0), ("maximum_m", -1.0)):
        # From the end at which rays are lost, the border lies where the log-likelihood ratio of `gate here` to `no
        # gate` is largest: a cumulative sum.
        order = np.argsort(sign * r)
        # Nine of ten lost on one side, as against one of a hundred.
        score = np.cumsum(np.where(lost[order], np.log(90.0), np.log(0.1)))
        score = score[: int(np.argmax(score < -GATED)) or None]  # returns have begun
        if len(score) and score.max() > GATED:
            border = float(r[order][int(score.argmax())])
            starts += [{name: border + sign * past} for past in PAST_M]
    return tuple(starts)


def _sector(ev: Evidence) -> tuple[Start, ...]:
    hit = ev.rays.hit
    azimuth_bin = np.floor((ev.rays.azimuth_rad[hit] + np.pi) / BIN_RAD).astype(int)
    # A hidden sector is a run of bins in which nearly every ray is lost.
    count = np.bincount(azimuth_bin)
    lost = np.bincount(azimuth_bin, ~ev.returned[hit])
    seen = np.flatnonzero(count)
    hidden = np.flatnonzero(lost[seen] > HIDDEN * count[seen])
    if not len(hidden):
        return ()
    run = max(np.split(hidden, np.flatnonzero(np.diff(hidden) > 1) + 1), key=len)
    # The border lies between the last bin that is seen and the first that is hidden.
    ends = seen[np.clip([run[0] - 1, run[-1] + 1], 0, len(seen) - 1)]
    low = (seen[run[0]] + ends[0]) / 2
    high = (seen[run[-1]] + ends[1]) / 2
    width = (high - low) * BIN_RAD
    middle = ((low + high + 1) / 2) * BIN_RAD - np.pi
    return tuple({"azimuth_rad": float(middle), "width_rad": float(share * width)} for share in (0.7, 1.0, 1.4))


READ: dict[str, Callable[[Evidence], tuple[Start, ...]]] = {
    "saturation": _ceiling,
    "range_gate": _gate,
    "sector_occlusion": _sector,
}
