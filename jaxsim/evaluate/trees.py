"""Gradient-boosted trees of single cells, the bar from outside: of the cell alone, and with its surroundings by hand.

Histogram trees of scikit-learn (an extra: `pip install 'jaxsim-lidar[trees]'`), by the absolute error. What a network
learns from an image these are told: means and spreads of grey and of range over three sizes, what the neighbouring
lines see, the image's exposure. A network that sees the image must beat them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from jaxsim.evaluate.baselines import Baseline, Guess
from jaxsim.files import need
from jaxsim.frame import Pair
from jaxsim.metrics.paired import DROP_BELOW

SIZES = (3, 7, 15)
"""Cells to a side of the surroundings."""
ALONE = {"max_iter": 150, "learning_rate": 0.15}
WITH_CONTEXT = {"max_iter": 300, "learning_rate": 0.08}
SHARED = {"max_leaf_nodes": 63, "early_stopping": False, "random_state": 0}
OF_DROPS = {"max_iter": 100, "learning_rate": 0.15}
EVERY_ALONE, EVERY_WITH_CONTEXT = 5, 4
"""Every so many of the training cells are learned from."""


def fit_trees(train: Sequence[Pair], *, context: bool) -> Baseline:
    """Trees for the intensity of what returns and for the drops. The same frames give the same trees.

    Raises ModuleNotFoundError without scikit-learn.
    """
    ensemble = need("sklearn.ensemble", "trees", by="trees")
    every, settings = (EVERY_WITH_CONTEXT, WITH_CONTEXT) if context else (EVERY_ALONE, ALONE)
    inputs = []
    intensity = []
    returned = []
    for pair in train:
        seen = np.asarray(pair.painted.valid)
        inputs.append(_features(pair, context=context)[seen])
        intensity.append(np.asarray(pair.measured.intensity)[seen])
        returned.append(np.asarray(pair.measured.valid)[seen])
    x = np.concatenate(inputs)
    y = np.concatenate(intensity)
    back = np.concatenate(returned)
    of_intensity: Any = ensemble.HistGradientBoostingRegressor(loss="absolute_error", **settings, **SHARED)
    of_intensity.fit(x[back][::every], y[back][::every])
    dropped = ~back | (y < DROP_BELOW)
    of_drops: Any = None
    if dropped[::every].any() and not dropped[::every].all():
        of_drops = ensemble.HistGradientBoostingClassifier(**OF_DROPS, **SHARED)
        of_drops.fit(x[::every], dropped[::every])

    def guess(pair: Pair) -> Guess:
        shape = pair.target.shape
        cells = _features(pair, context=context).reshape(shape[0] * shape[1], -1)
        value = np.clip(of_intensity.predict(cells), 0, 0.99).astype(np.float32).reshape(shape)
        drops = np.zeros(shape, bool) if of_drops is None else of_drops.predict(cells).reshape(shape)
        return Guess(value, drops)

    return guess


def _features(pair: Pair, *, context: bool) -> Float[np.ndarray, "rows columns k"]:
    """The columns of the trees for each cell; NaN, which trees take, where the camera saw nothing."""
    painted = pair.painted
    seen = np.asarray(painted.valid)
    rows, columns = seen.shape
    unknown = np.float32(np.nan)
    rgb = np.where(seen[..., None], painted.rgb, unknown).astype(np.float32)
    away = np.where(seen, painted.range_m, unknown).astype(np.float32)
    angle = np.where(seen, pair.incidence_rad, unknown).astype(np.float32)
    column = np.broadcast_to(np.abs(np.linspace(-1, 1, columns, dtype=np.float32)), (rows, columns))
    depth = np.where(seen, painted.depth_m, unknown)
    channels = [away, angle, np.asarray(pair.row), *np.moveaxis(rgb, -1, 0), column, depth]
    if context:
        channels += _surroundings(rgb, away, angle, seen=seen)
    return np.stack([np.asarray(channel, np.float32) for channel in channels], axis=-1)


def _surroundings(rgb: np.ndarray, away: np.ndarray, angle: np.ndarray, *, seen: np.ndarray) -> list[np.ndarray]:
    """What a network would learn from the image, by hand: contrasts, exposure, and what neighbouring lines see."""
    grey = rgb.mean(-1)
    logarithm = np.log(np.maximum(away, 1))
    channels = []
    for size in SIZES:
        channels += [*_mean_and_spread(grey, seen, size), _mean_and_spread(logarithm, seen, size)[1]]
        channels.append(cv2.blur(seen.astype(np.float32), (size, size)))
    colours = (angle, rgb[..., 0] - rgb[..., 2], rgb[..., 1] - grey)
    channels += [_mean_and_spread(channel, seen, 5)[0] for channel in colours]
    low, middle, high = np.quantile(grey[seen], (0.1, 0.5, 0.9)) if seen.any() else (0.0, 0.5, 1.0)
    span = max(high - low, 1e-3)
    channels += [grey - middle, (grey - low) / span, np.full_like(grey, middle), np.full_like(grey, span)]
    for step in (-4, -2, 2, 4):
        channels += [_shifted(away, step), _shifted(angle, step)]
    return channels


def _mean_and_spread(value: np.ndarray, seen: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The mean and the standard deviation over the seen cells of a square around each cell."""
    blur = lambda x: cv2.blur(np.where(seen, x, 0).astype(np.float64), (size, size))  # noqa: E731
    share = np.maximum(blur(np.ones_like(value)), 1e-9)
    mean = blur(value) / share
    return mean, np.sqrt(np.maximum(blur(value * value) / share - mean * mean, 0))


def _shifted(value: np.ndarray, step: int) -> np.ndarray:
    """What the line `step` below sees; NaN beyond the window."""
    moved = np.full_like(value, np.nan)
    if step > 0:
        moved[:-step] = value[step:]
    else:
        moved[-step:] = value[:step]
    return moved
