"""Which scenes are for finding an effect and which, never looked at before, for judging it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import t as student

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


LEVEL = 0.90


def half_width(scenes: Float[np.ndarray, "u *k"]) -> Float[np.ndarray, "*k"]:
    """Half width of the interval of each mean over the first axis; NaN entries do not count, NaN where fewer than two
    are left."""
    known = np.isfinite(scenes)
    n = known.sum(0)
    centre = np.where(known, scenes, 0).sum(0) / np.maximum(n, 1)
    squares = np.where(known, (scenes - centre) ** 2, 0).sum(0)
    reach = student.ppf(0.5 + LEVEL / 2, np.maximum(n - 1, 1))
    width = reach * np.sqrt(squares / np.maximum(n - 1, 1) / np.maximum(n, 1))
    return np.where(n > 1, width, np.nan)


def mean_interval(scenes: Float[np.ndarray, " u"]) -> tuple[float, float]:
    """Interval of a mean over scenes; NaN where fewer than two scenes have a value."""
    if not np.isfinite(scenes).any():
        return float("nan"), float("nan")
    centre, half = float(np.nanmean(scenes)), float(half_width(scenes))
    return centre - half, centre + half


def ratio_interval(top: Float[np.ndarray, " u"], bottom: Float[np.ndarray, " u"]) -> tuple[float, float]:
    """Interval of mean(top) / mean(bottom), by the jackknife over scenes that have both."""
    both = np.isfinite(top) & np.isfinite(bottom)
    top, bottom = top[both], bottom[both]
    n = len(top)
    if n < 2:
        return float("nan"), float("nan")
    without = (top.sum() - top) / (bottom.sum() - bottom)
    half = student.ppf(0.5 + LEVEL / 2, n - 1) * np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum())
    value = top.sum() / bottom.sum()
    return float(value - half), float(value + half)


def difference_interval(first: Float[np.ndarray, " u"], second: Float[np.ndarray, " v"]) -> tuple[float, float]:
    """Interval of mean(first) - mean(second), in their unit, of two independent groups of scenes whose scatter may
    differ (Welch 1947, doi 10.1093/biomet/34.1-2.28); NaN where either has fewer than two scenes."""
    if min(len(first), len(second)) < 2:
        return float("nan"), float("nan")
    centre = float(first.mean() - second.mean())
    ours, theirs = first.var(ddof=1) / len(first), second.var(ddof=1) / len(second)
    if ours + theirs == 0:
        return centre, centre
    freedom = (ours + theirs) ** 2 / (ours**2 / (len(first) - 1) + theirs**2 / (len(second) - 1))
    half = float(student.ppf(0.5 + LEVEL / 2, freedom) * np.sqrt(ours + theirs))
    return centre - half, centre + half


def fold_half_width(fits: Float[np.ndarray, "g k"]) -> Float[np.ndarray, " k"]:
    """Half width of the interval of a mean of fits, each of which left out one of g groups of scenes: the jackknife
    again, by whose factor fits are farther apart than they look, since any two share scenes."""
    groups = len(fits)
    reach = student.ppf(0.5 + LEVEL / 2, max(groups - 1, 1))
    return reach * (groups - 1) / np.sqrt(groups) * fits.std(0, ddof=1)


FLIPS = 4096
"""Of signs over units, to see what chance does."""


def p_value(gains: Float[np.ndarray, " u"]) -> float:
    """One-sided probability of so large a mean gain if units gain nothing: exact sign-flip test up to 12 units,
    else by FLIPS draws."""
    if not gains.any():
        return 1.0
    return float(np.mean(signs_of(len(gains)) @ gains >= gains.sum() - 1e-12))


def chance_of_best(rates: Float[np.ndarray, "p u"], best: int) -> float:
    """How often chance makes the units of some row agree as well as those of row `best`: trying many is paid for
    (Westfall & Young 1993, max-T, by signs over units). A row counts by its sum in units of its own scatter: one that
    a single unit makes large does not hide the others."""
    scaled = rates / (np.sqrt((rates**2).sum(1, keepdims=True)) + 1e-12)
    return float(np.mean((signs_of(rates.shape[1]) @ scaled.T).max(1) >= scaled[best].sum() - 1e-9))


def signs_of(n: int) -> Float[np.ndarray, "k n"]:
    """All ways to give n units signs, up to 12 units; else FLIPS at random, the first all positive."""
    if n <= 12:
        return 1.0 - 2 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (FLIPS, n))
    signs[0] = 1
    return signs


AGREE = 3
"""Units that must agree: no gain or loss counts for more than the third largest."""


def clipped(gain: Float[np.ndarray, " u"]) -> Float[np.ndarray, " u"]:
    """Units' gains and losses, none larger than the third largest of either: no one or two scenes decide."""
    sizes = np.sort(np.abs(gain))
    most = sizes[-min(AGREE, len(sizes))]
    return np.clip(gain, -most, most)
