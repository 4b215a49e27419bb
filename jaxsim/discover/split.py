"""Which scenes are for finding an effect and which, never looked at before, for judging it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

JUDGE_SHARE = 1 / 3
FOLDS = 3
"""Parts of the find scenes, each held out of a fit once."""
FEWEST = 10
"""Units that a verdict needs: 7 to find with, for the signs of fewer cannot agree so well that chance is ruled out at
the level that naming asks for (`name.LEVEL`, of the better of two tests: 2 x 2^-7), and 3 to judge on."""


@dataclass(frozen=True)
class Split:
    """Units by name, and the hash that fixes the division before anything is fitted."""

    find: tuple[str, ...]
    judge: tuple[str, ...]
    sha256: str


def split(names: Sequence[str]) -> Split:
    """Divides units by the hash of their names: two thirds to find, one third to judge; the same names always
    divide alike.

    Raises ValueError for fewer than FEWEST units.
    """
    names = list(dict.fromkeys(names))
    if len(names) < FEWEST:
        raise ValueError(
            f"discover: {len(names)} independent scenes; a verdict needs {FEWEST} or more (16 to tell effects apart "
            "well). Frames of one drive count as one scene: give more drives, or one drive alone, which is cut into "
            "sectors of azimuth"
        )
    order = sorted(names, key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    count = max(2, round(len(names) * JUDGE_SHARE))
    judge, find = sorted(order[:count]), sorted(order[count:])
    text = "\n".join(["find", *find, "judge", *judge])
    return Split(tuple(find), tuple(judge), hashlib.sha256(text.encode()).hexdigest())


def folds(unit: Int[np.ndarray, " b"], count: int = FOLDS) -> Float[np.ndarray, "k b"]:
    """For each fold, 1 for the blocks that are fitted and 0 for those held out; units stay together."""
    units = np.unique(unit)
    group = np.searchsorted(units, unit) % min(count, len(units))
    return (group[None, :] != np.arange(min(count, len(units)))[:, None]).astype(np.float32)
