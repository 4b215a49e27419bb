"""Scores of a trained generator, and of the baselines beside it, on prepared pairs.

A cell counts where the camera saw it: there, and only there, the network can know anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from jaxsim.frame import Array, Pair
from jaxsim.metrics import GroupMeans, Score, group_means, paired_scores, paired_sums
from jaxsim.metrics.paired import DROP_BELOW

Predict = Callable[[Any, Pair], Array]
CLASSES = 34


def _total(sums: Iterable[dict[str, Array]]) -> dict[str, Score]:
    frames = list(sums)
    return paired_scores({key: sum(float(frame[key]) for frame in frames) for key in frames[0]})


def _sums(intensity: Array, drops: Array, pair: Pair) -> dict[str, Array]:
    measured = pair.measured
    return paired_sums(intensity, drops, measured.intensity, returned=measured.valid, m=pair.painted.valid)


def score_pairs(predict: Predict, params: Any, pairs: Sequence[Pair]) -> dict[str, Score]:
    """Paired scores of a generator (`mae`, `rmse`, `psnr`, `ssim`, `drop_iou`, `drop_f1`)."""
    predictions = ((predict(params, pair), pair) for pair in pairs)
    return _total(_sums(x, x < DROP_BELOW, pair) for x, pair in predictions)


GROUPS: dict[str, Callable[[Pair], np.ndarray]] = {
    "global mean": lambda pair: np.zeros(pair.target.shape, int),
    "per-class mean": lambda pair: np.clip(pair.painted.semantic, 0, CLASSES - 1),
    "per-row mean": lambda pair: np.broadcast_to(np.arange(len(pair.target))[:, None], pair.target.shape),
}
"""The baselines that average training cells: name -> group of each cell."""


def baseline_scores(
    train: Sequence[Pair], judged: Sequence[Pair], previous: Sequence[Pair | None]
) -> dict[str, dict[str, Score]]:
    """Scores of each baseline on `judged`; `previous` holds the frame before each, None where there is none.

    The previous frame's intensity is copied cell by cell; where it has none, the global mean stands in.
    """
    found: dict[str, dict[str, Score]] = {}
    means: dict[str, GroupMeans] = {}
    for name, group in GROUPS.items():
        if name == "per-class mean" and not any((pair.painted.semantic > 0).any() for pair in train):
            continue
        rows = max(len(pair.target) for pair in [*train, *judged])
        measured = ((pair.measured.intensity, pair.measured.valid, pair.painted.valid, group(pair)) for pair in train)
        means[name] = group_means(measured, max(rows, CLASSES))
        mean = means[name]
        found[name] = _total(
            _sums(mean.intensity.astype(np.float32)[group(pair)], mean.drops[group(pair)], pair) for pair in judged
        )
    copied = [(pair, before.measured) for pair, before in zip(judged, previous, strict=True) if before]
    if copied:
        filling = np.float32(means["global mean"].intensity[0])
        found["previous frame"] = _total(
            _sums(
                np.where(before.valid, before.intensity, filling),
                ~before.valid | (before.intensity < DROP_BELOW),
                pair,
            )
            for pair, before in copied
        )
    return found
