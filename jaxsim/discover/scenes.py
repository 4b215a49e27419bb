"""Statistics over scenes: how they are divided, and what so few of them can say of chance and of scatter.

The scene is the statistical unit: rays and frames of one street share its surfaces, its pose and its weather, so that
only scenes are independent. Letters: s scenes, b blocks of columns (each of one scene), c candidates, k columns.

- Division: by the hash of the scenes' names, before anything is fitted; folds deal the find scenes in turn.
- Chance: a scene gains as likely as it loses where there is nothing to find, so the signs of its gains are exchangeable
  (Fisher's randomisation test): all 2^s of them up to twelve scenes, drawn ones beyond. Where the best of many is
  asked about, the largest over all of them is held against the same signs (max-T, Westfall & Young 1993), which pays
  for trying many without supposing them independent.
- Clipping: no scene counts for more than the third largest, so that no one or two decide.
- Scatter: `jaxsim/metrics/intervals.py` has the intervals of means, ratios and scores, and of fits that share scenes;
  here are those of differences.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import stdtrit

from jaxsim.discover.rules import RULES
from jaxsim.metrics.intervals import jackknife_half_width, student_reach

ROUNDING = 1e-9
"""Of the sum of what is added, by which sums in another order may differ."""
ORDER_PARTS = 64
"""Parts in which orders are worked through."""
MEDIAN_TO_SD = 1.4826
"""From a median absolute deviation to a normal's standard deviation."""


@dataclass(frozen=True)
class Split:
    """Scenes by name, and the hash that fixes the division before anything is fitted."""

    find: tuple[str, ...]
    judge: tuple[str, ...]
    sha256: str


def split_scenes(names: Sequence[str], *, fewest: int = RULES.fewest_scenes) -> Split:
    """Divides scenes by the hash of their names: two thirds to find, one third to judge; the same names always divide
    alike.

    Raises ValueError for fewer scenes than `fewest`.
    """
    names = list(dict.fromkeys(names))
    if len(names) < fewest:
        raise ValueError(
            f"discover: {len(names)} independent scenes; a verdict needs {fewest} or more (16 to tell "
            "effects apart well)"
        )
    order = sorted(names, key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    # Two at least: one judge scene has no scatter.
    count = max(2, round(len(names) * RULES.judge_share))
    judge = sorted(order[:count])
    find = sorted(order[count:])
    text = "\n".join(["find", *find, "judge", *judge])
    return Split(tuple(find), tuple(judge), hashlib.sha256(text.encode()).hexdigest())


def scene_means(frames: Iterable[tuple[str, Float[np.ndarray, " k"]]]) -> Float[np.ndarray, "s k"]:
    """A row a scene: the mean over its frames' numbers that are known, NaN where none is. Frames come one by one, each
    with the name of its scene, and are forgotten."""
    rows: dict[str, list[np.ndarray]] = {}
    for scene, numbers in frames:
        rows.setdefault(scene, []).append(numbers)
    known = [np.isfinite(of_scene) for of_scene in rows.values()]
    sums = [np.where(k, of_scene, 0).sum(0) for k, of_scene in zip(known, rows.values(), strict=True)]
    counts = np.array([k.sum(0) for k in known])
    return np.where(counts > 0, np.array(sums) / np.maximum(counts, 1), np.nan)


def folds(scene: Int[np.ndarray, " b"], count: int = RULES.folds) -> Float[np.ndarray, "k b"]:
    """For each fold, 1 for the blocks that are fitted and 0 for those held out; blocks of a scene stay together.

    Of each `count` scenes in a row every fold holds out one, in an order of chance: folds are alike in time, and where
    every third drive has something that the others have not, no fold has all of these."""
    scenes = np.unique(scene)
    count = min(count, len(scenes))
    chance = np.random.default_rng(0)
    dealt = np.concatenate([chance.permutation(count) for _ in range(-(-len(scenes) // count))])
    group = dealt[np.searchsorted(scenes, scene)]
    return (group[None, :] != np.arange(count)[:, None]).astype(np.float32)


def clipped(gain: Float[np.ndarray, " s"]) -> Float[np.ndarray, " s"]:
    """Scenes' gains and losses, none larger than the third largest of either: no one or two scenes decide."""
    sizes = np.sort(np.abs(gain))
    limit = sizes[-min(RULES.decisive_scenes, len(sizes))]
    return np.clip(gain, -limit, limit)


def signs_of(scenes: int) -> Float[np.ndarray, "k s"]:
    """All ways to give the scenes signs, or where these are more than `Rules.sign_draws`, so many at random, the first
    all positive: it is what was measured."""
    if 2**scenes <= RULES.sign_draws:
        # Bit j of k turns scene j round; k = 0 turns none, which is what was measured.
        return 1.0 - 2 * ((np.arange(2**scenes)[:, None] >> np.arange(scenes)) & 1)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (RULES.sign_draws, scenes))
    signs[0] = 1
    return signs


def orders_of(scenes: int) -> Int[np.ndarray, "k s"]:
    """`Rules.sign_draws` orders in which scenes may be dealt out anew where nothing tells them apart."""
    rng = np.random.default_rng(0)
    return rng.permuted(np.tile(np.arange(scenes), (RULES.sign_draws, 1)), axis=1)


def orders_in_parts(scenes: int) -> list[Int[np.ndarray, "d s"]]:
    """The orders a few at a time: of many scenes there are many thousand groups, and not all sums have room at once."""
    return np.array_split(orders_of(scenes), ORDER_PARTS)


def chance_of(by_chance: Float[np.ndarray, " k"], observed: float) -> float:
    """Probability of reaching `observed` by chance, from draws that do not hold what was measured: that is one more
    (Phipson & Smyth 2010). An `observed` that is no number is reached by all: it shows nothing."""
    return float((1 + np.sum(~(by_chance < observed - 1e-9))) / (1 + len(by_chance)))


def scaled_groups(whole: Bool[np.ndarray, "k n"]) -> Float[np.ndarray, "k n"]:
    """Groups of scenes as weights: a group's sum of numbers of mean 0 is in units of what those of so many scenes vary
    by when they are dealt out anew."""
    scenes = whole.shape[1]
    count = whole.sum(1)
    # Drawn without replacement: a group of all scenes but one varies as little as that one.
    return whole / np.sqrt(count * (scenes - count) / scenes)[:, None]


def dealt(excess: Float[np.ndarray, " n"], whole: Bool[np.ndarray, "k n"]) -> tuple[int, float]:
    """The group of scenes (a row says which are in it) that exceeds the others most, and how often some group does when
    excesses are dealt out to the scenes anew (`Rules.sign_draws` times)."""
    off = clipped(excess - excess.mean())
    # Clipping leaves a mean, which groups of more scenes would gather.
    off = off - off.mean()
    scaled = scaled_groups(whole)
    observed = scaled @ off
    best = int(observed.argmax())
    largest = [(off[some] @ scaled.T).max(1) for some in orders_in_parts(len(off))]
    return best, chance_of(np.concatenate(largest), observed[best])


def strongest(scaled: Float[np.ndarray, "c s"], signs: Float[np.ndarray, "k s"]) -> Float[np.ndarray, " k"]:
    """The largest sum over scenes of all candidates, under each choice of the scenes' signs (max-T)."""
    return (signs @ scaled.T).max(1)


def false_discovery_rates(p: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The q-value of each question, of the p-values of all that were asked (Benjamini & Hochberg 1995)."""
    # As `scipy.stats.false_discovery_control`, whose import takes as long as all other questions about regimes.
    falling = np.argsort(-p, kind="stable")
    rates = np.empty(len(p))
    rates[falling] = np.minimum.accumulate(p[falling] * len(p) / np.arange(len(p), 0, -1))
    return rates.clip(max=1)


def p_value(gains: Float[np.ndarray, " s"]) -> float:
    """One-sided probability of so large a mean gain if scenes gain nothing, by the signs of `signs_of`; 1 where a gain
    is no number."""
    if not gains.any():
        return 1.0
    # Sums of the same gains in another order differ by rounding: what was measured must reach itself.
    gains = gains.astype(np.float64)
    reached = gains.sum() - ROUNDING * np.abs(gains).sum()
    return float(np.mean(~(signs_of(len(gains)) @ gains < reached)))


def attainable(level: float, scenes: int, *, tests: int = 1) -> float:
    """The level, or the probability that perfect agreement of so few scenes has in the better of so many tests, where
    that is larger: then all must agree."""
    # A percent above it: what reaches it exactly passes.
    return max(level, 1.01 * tests * 2.0**-scenes)


def best_of_gains(gains: Float[np.ndarray, "c s"]) -> tuple[int, float]:
    """The candidate whose scenes agree most that it gains, and how often chance makes some candidate's agree as much.

    Held-out gains lie below 0 where there is nothing to find, for what was fitted to chance costs; so their deviations
    from each candidate's mean take the signs. That is safe where means lie clearly below 0; at a mean of 0 itself
    chance agrees as well more often than is said, and most of many candidates.
    """
    off = gains - gains.mean(1, keepdims=True)
    spread = np.sqrt((off**2).sum(1)) + 1e-9
    agreement = gains.sum(1) / spread
    by_chance = strongest(off / spread[:, None], signs_of(gains.shape[1]))
    best = int(agreement.argmax())
    # Of deviations no choice of signs is what was measured.
    return best, chance_of(by_chance, agreement[best])


def rank_correlation(first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"]) -> float:
    """Spearman's: the correlation of ranks; what is equal shares the mean of its ranks."""
    ranks = []
    for values in (first, second):
        _, place, count = np.unique(values, return_inverse=True, return_counts=True)
        ranks.append((np.cumsum(count) - count / 2)[place])
    return float(np.corrcoef(*ranks)[0, 1])


def difference_interval(first: Float[np.ndarray, " s"], second: Float[np.ndarray, " t"]) -> tuple[float, float]:
    """Interval of mean(first) - mean(second), in their unit, of two independent groups of scenes whose scatter may
    differ (Welch 1947, doi 10.1093/biomet/34.1-2.28); NaN where either has fewer than two scenes."""
    if min(len(first), len(second)) < 2:
        return float("nan"), float("nan")
    centre = float(first.mean() - second.mean())
    variance_first = first.var(ddof=1) / len(first)
    variance_second = second.var(ddof=1) / len(second)
    variance = variance_first + variance_second
    if variance == 0:
        return centre, centre
    # Degrees of freedom by Welch and Satterthwaite: near those of the group that scatters more.
    freedom = variance**2 / (variance_first**2 / (len(first) - 1) + variance_second**2 / (len(second) - 1))
    half = float(stdtrit(freedom, 0.5 + RULES.interval_level / 2) * np.sqrt(variance))
    return centre - half, centre + half


def jackknife_sd(fits: Float[np.ndarray, "g k"]) -> Float[np.ndarray, " k"]:
    """Standard deviation of a fit to all scenes, from fits each of which left out one of g groups."""
    return jackknife_half_width(fits) / student_reach(len(fits))
