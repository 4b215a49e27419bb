"""Whether what judges a network is what it learned from: frames on both sides of a split, copies of them, scenes."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxsim.data.records import PreparedPairs
from jaxsim.files import digest_of_values

_log = logging.getLogger(__name__)

MOST = 1000
"""Frames whose values are compared; of more, which would have to be read from disk first, only their keys are."""


class SplitSide(NamedTuple):
    """The frames on one side of a split."""

    keys: Sequence[Any]
    """What tells a frame of the data set from others."""
    values: Callable[[int], Iterable[np.ndarray]] | None = None
    """What the sensor measured of a frame, which is the same in a copy of its files; None where that is not known."""


def side_of_pairs(pairs: PreparedPairs) -> SplitSide:
    """The pairs as a side of a split."""

    def values(i: int) -> list[np.ndarray]:
        measured = pairs[i].measured
        return [np.asarray(measured.range_m)[measured.valid], np.asarray(measured.intensity)[measured.valid]]

    return SplitSide(pairs.keys, values)


def warn_of_seen_pairs(learned: PreparedPairs, judged: PreparedPairs) -> None:
    """Warns where pairs that judge are among those that are learned from, are copies of them or of their scenes."""
    if not warn_of_seen(side_of_pairs(learned), side_of_pairs(judged), names=judged.names):
        warn_of_scenes({*learned.scenes} & {*judged.scenes}, who="the network")


def warn_of_seen(learned: SplitSide, judged: SplitSide, *, names: Sequence[str]) -> bool:
    """Warns where frames that judge, of these names, are learned from too, or are copies of such; whether it did."""
    seen = frames_seen(learned, judged)
    if seen:
        _log.warning(
            f"{len(seen)} of the {len(names)} frames that judge are training frames too, or copies of them (the first: "
            f"{names[seen[0]]}): scores then tell what was learned by heart, not what frames that were never seen "
            "would get; choose others for one of the two"
        )
    return bool(seen)


def warn_of_scenes(shared: Collection[str], *, who: str) -> None:
    """Warns of scenes on both sides of a split; `who` is scored on them."""
    if shared:
        _log.warning(
            f"scenes on both sides of the split, {', '.join(sorted(shared)[:3])}: {who} is then scored on streets that "
            "it has seen"
        )


def frames_seen(learned: SplitSide, judged: SplitSide) -> list[int]:
    """Which of the frames that judge are on the other side, too, by their keys or by what was measured."""
    keys = {*learned.keys}
    seen = {i for i, key in enumerate(judged.keys) if key in keys}
    if learned.values is not None and judged.values is not None and len(keys) + len(judged.keys) <= MOST:
        known = {_digest(learned.values(i)) for i in range(len(learned.keys))} - {""}
        seen |= {i for i in range(len(judged.keys)) if i not in seen and _digest(judged.values(i)) in known}
    return sorted(seen)


def _digest(values: Iterable[np.ndarray]) -> str:
    """The digest of a frame's values; empty where there are none, as of a frame that no LiDAR measured."""
    arrays = list(values)
    return digest_of_values(arrays) if any(array.size for array in arrays) else ""
