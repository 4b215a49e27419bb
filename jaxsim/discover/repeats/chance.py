"""How far scenes agree on patterns, and how often chance makes some pattern agree as well (max-T over all).

A scene's residuals are as likely as their negative where nothing repeats, scene by scene; so all scales and channels
take the same signs, and the largest of all statistics under each choice of signs gives exact probabilities that pay for
having looked everywhere (Westfall & Young 1993). Every spread by which a statistic is divided stays the same when
scenes change their signs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Num

CHUNK = 256
"""Choices of signs that are looked at together."""


@dataclass(frozen=True)
class Agreement:
    """How far scenes agree on k patterns."""

    strength: Float[np.ndarray, " k"]
    """|sum over scenes| in units of its spread."""
    by_chance: Float[np.ndarray, " f"]
    """The largest strength under each choice of signs."""
    gain: Float[np.ndarray, " k"]
    """The part of the squared sum that two scenes share, per unit of information: patterns of all scales compare."""


def scatter(sums: Num[np.ndarray, "n k"], information: Float[np.ndarray, " k"]) -> float:
    """How much patterns of one kind scatter from scene to scene, over what the weights say."""
    return float((np.abs(sums) ** 2).sum() / max(information.sum(), 1e-12))


def of_patterns(
    sums: Num[np.ndarray, "n k"],
    information: Float[np.ndarray, " k"],
    signs: Float[np.ndarray, "f n"],
    *,
    usual: float,
) -> Agreement:
    """Asks of each pattern alone. `information` is its sum's variance as the weights have it, all scenes together;
    `usual` the `scatter` of its kind.

    Half of the spread is what a pattern scatters by itself, half what its kind does: few scenes that are alike by
    chance, or a place at which nothing rare happened, must not look sure.
    """
    squares = (np.abs(sums) ** 2).sum(0)
    spread = np.sqrt((squares + usual * information) / 2)
    spread = np.where(spread > 1e-9 * max(spread.max(initial=0), 1e-12), spread, np.inf)
    scaled = sums / spread
    by_chance = [np.abs(signs[k : k + CHUNK] @ scaled).max(1, initial=0) for k in range(0, len(signs), CHUNK)]
    # A wave's size is told by cosines and sines, each of half its sum's variance.
    shared = (np.abs(sums.sum(0)) ** 2 - squares) * (2 if np.iscomplexobj(sums) else 1)
    return Agreement(np.abs(scaled.sum(0)), np.concatenate(by_chance), shared / np.maximum(information, 1e-12))


def of_maps(
    sums: Float[np.ndarray, "n k"], information: Float[np.ndarray, " k"], signs: Float[np.ndarray, "f n"]
) -> Agreement:
    """Asks of all patterns together: whether the maps of scenes resemble each other, pair by pair, whatever they show.
    One statistic, which sees also what each place alone is too weak, or too rarely seen, to show."""
    pairs = alike(sums)
    spread = np.sqrt((pairs**2).sum() / 2)
    if spread <= 0:
        return Agreement(np.zeros(1), np.zeros(len(signs)), np.zeros(1))
    # Scenes of one sign for all places: what is asked is whether maps agree, not where.
    by_chance = ((signs @ pairs) * signs).sum(1) / 2 / spread
    observed = np.array([pairs.sum() / 2 / spread])
    squares = (sums**2).sum(0)
    gain = np.where(information > 0, (sums.sum(0) ** 2 - squares) / np.maximum(information, 1e-12), 0)
    return Agreement(_as_one(observed, len(sums)), _as_one(by_chance, len(sums)), np.array([gain.sum()]))


def _as_one(pairwise: Float[np.ndarray, " f"], scenes: int) -> Float[np.ndarray, " f"]:
    """Strength of pairs on the scale of patterns: of scenes all alike both are the same under any signs. Otherwise a
    scene's change of sign would leave pairs stronger than any single pattern can be."""
    return np.sqrt(2 * np.maximum(1 + pairwise * np.sqrt(2 * (scenes - 1) / scenes), 0))


def alike(sums: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n n"]:
    """Products of each two scenes' maps, 0 of a scene with itself."""
    pairs = sums @ sums.T
    np.fill_diagonal(pairs, 0)
    return pairs
