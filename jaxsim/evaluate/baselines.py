"""What a network must beat: predictors that are fitted to the same training frames and see no more than it does.

global, row mean      one number for all cells, one a laser line
median, row median    the same, by what the absolute error asks for
table                 the median of the cell's line, range and angle of incidence: a sensor model without a camera
trees                 boosted trees of each cell alone, and with its surroundings by hand
previous frame        the last measured frame, copied

Trees are scikit-learn's histogram trees (an extra: `pip install 'jaxsim-lidar[trees]'`), by the absolute error. What a
network learns from an image these are told: means and spreads of grey and of range over three sizes, what the
neighbouring lines see, the image's exposure. A network that sees the image must beat them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.files import need
from jaxsim.frame import CLASSES, LOST_BELOW, Pair
from jaxsim.metrics.paired import GroupLevels, group_levels

BEAM_PLACES = 64
"""Lines that the table tells apart, as the network's `beam` does."""
RANGES_M = np.array([3, 4, 5, 6, 7.5, 9, 11, 13, 16, 20, 25, 32, 42, 60])
ANGLES_RAD = np.deg2rad([20, 40, 55, 65, 72, 78, 82, 86])
FEWEST_CELLS = 30
"""Training cells below which a cell of the table takes its line's median."""
NEIGHBOURHOODS = (3, 7, 15)
"""Cells to a side of the surroundings."""
ALONE = {"max_iter": 150, "learning_rate": 0.15}
WITH_CONTEXT = {"max_iter": 300, "learning_rate": 0.08}
SHARED = {"max_leaf_nodes": 63, "early_stopping": False, "random_state": 0}
OF_DROPS = {"max_iter": 100, "learning_rate": 0.15}
EVERY_ALONE, EVERY_WITH_CONTEXT = 5, 4
"""Every so many of the training cells are learned from."""


class Guess(NamedTuple):
    """What a baseline says of each cell of a window."""

    intensity: Float[np.ndarray, "rows columns"]
    drops: Bool[np.ndarray, "rows columns"]


Baseline = Callable[[Pair], Guess]
Group = Callable[[Pair], Int[np.ndarray, "rows columns"]]


class SeenCells(NamedTuple):
    """The training cells that the camera saw: what tables of them need."""

    intensity: Float[np.ndarray, " n"]
    returned: Bool[np.ndarray, " n"]
    share: Float[np.ndarray, " n"]
    """Of the cell's laser line (`row_share`)."""
    kind: Int[np.ndarray, " n"]
    """Class."""
    place: Int[np.ndarray, " n"]
    """In the table of line, range and incidence."""


def seen_cells(pairs: Iterable[Pair]) -> SeenCells:
    """The cells of pairs, each of which is read once and let go."""
    parts = []
    for pair in pairs:
        small = class_of(pair).astype(np.int8), place_in_table(pair).astype(np.int16)
        of_cells = (pair.measured.intensity, pair.measured.valid, pair.row_share, *small)
        parts.append([np.asarray(raster)[np.asarray(pair.painted.valid)] for raster in of_cells])
    return SeenCells._make([np.concatenate(column) for column in zip(*parts, strict=True)])


def place_in_table(pair: Pair) -> Int[np.ndarray, "rows columns"]:
    """The cell's place in the table of line, range and incidence."""
    line = np.round(np.asarray(pair.row_share) * (BEAM_PLACES - 1)).astype(int)
    away = np.searchsorted(RANGES_M, np.asarray(pair.painted.range_m))
    angle = np.searchsorted(ANGLES_RAD, np.asarray(pair.incidence_rad))
    # One number of mixed radix: so many borders part one bin more.
    return (line * (len(RANGES_M) + 1) + away) * (len(ANGLES_RAD) + 1) + angle


TABLE = BEAM_PLACES * (len(RANGES_M) + 1) * (len(ANGLES_RAD) + 1)


def class_of(pair: Pair) -> Int[np.ndarray, "rows columns"]:
    """The class that the camera paints on the cell."""
    return np.clip(np.asarray(pair.painted.semantic), 0, CLASSES - 1)


def fit_baselines(train: Iterable[Pair]) -> dict[str, Baseline]:
    """The baselines that tables of training cells give; a line that no training cell is of takes what all cells do.

    Raises ValueError where no training cell is both seen and returned.
    """
    cells = seen_cells(train)
    shares = np.unique(cells.share)

    def one_group(pair: Pair) -> Int[np.ndarray, "rows columns"]:
        return np.zeros(pair.target.shape, int)

    def line_of(share: Float[np.ndarray, "*n"]) -> Int[np.ndarray, "*n"]:
        # By its place in the sensor: windows of several cameras begin at different lines.
        line = np.searchsorted(shares, share)
        return np.where(shares[np.minimum(line, len(shares) - 1)] == share, line, len(shares))

    def levels(group: Int[np.ndarray, " n"], groups: int) -> GroupLevels:
        return group_levels(cells.intensity, cells.returned, group, groups=groups)

    every = levels(np.zeros(len(cells.share), int), 1)
    line = levels(line_of(cells.share), len(shares) + 1)
    of_line = lambda pair: line_of(np.asarray(pair.row_share))  # noqa: E731
    baselines = {"global mean": _of_groups(one_group, every.mean, every.drops)}
    # A source without labels paints 0 everywhere: one class, which is the global mean again.
    if cells.kind.any():
        kind = levels(cells.kind, CLASSES)
        baselines["per-class mean"] = _of_groups(class_of, kind.mean, kind.drops)
    baselines["per-row mean"] = _of_groups(of_line, line.mean, line.drops)
    baselines["global median"] = _of_groups(one_group, every.median, every.drops)
    baselines["per-row median"] = _of_groups(of_line, line.median, line.drops)
    baselines["range, incidence, row"] = _of_table(levels(cells.place, TABLE), baselines["per-row median"])
    return baselines


def _of_groups(group: Group, intensity: Float[np.ndarray, " n"], drops: Bool[np.ndarray, " n"]) -> Baseline:
    values = intensity.astype(np.float32)

    def guess(pair: Pair) -> Guess:
        of = group(pair)
        return Guess(values[of], drops[of])

    return guess


def _of_table(table: GroupLevels, otherwise: Baseline) -> Baseline:
    of_table = _of_groups(place_in_table, table.median, table.drops)

    def guess(pair: Pair) -> Guess:
        # A median of few cells is noise: the line's own is the better guess.
        known = table.count[place_in_table(pair)] >= FEWEST_CELLS
        cell, line = of_table(pair), otherwise(pair)
        return Guess(np.where(known, cell.intensity, line.intensity), np.where(known, cell.drops, line.drops))

    return guess


def previous_frame(before: Pair, filling: float) -> Guess:
    """The measured frame before, copied cell by cell; where it has no return, `filling` stands in."""
    measured = before.measured
    intensity = np.where(measured.valid, measured.intensity, np.float32(filling))
    return Guess(intensity, ~measured.valid | (measured.intensity < LOST_BELOW))


def fit_trees(train: Iterable[Pair], *, context: bool) -> Baseline:
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
    dropped = ~back | (y < LOST_BELOW)
    # A classifier needs cells of both outcomes; without them no drop is predicted.
    of_drops: Any = None
    if dropped[::every].any() and not dropped[::every].all():
        of_drops = ensemble.HistGradientBoostingClassifier(**OF_DROPS, **SHARED)
        of_drops.fit(x[::every], dropped[::every])

    def guess(pair: Pair) -> Guess:
        shape = pair.target.shape
        cells = _features(pair, context=context).reshape(shape[0] * shape[1], -1)
        # KITTI's sensor reports 0.99 at most.
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
    # How far from the middle: left and right are alike to a turning sensor.
    column = np.broadcast_to(np.abs(np.linspace(-1, 1, columns, dtype=np.float32)), (rows, columns))
    depth = np.where(seen, painted.depth_m, unknown)
    channels = [away, angle, np.asarray(pair.row_share), *np.moveaxis(rgb, -1, 0), column, depth]
    if context:
        channels += _surroundings(rgb, away, angle, seen=seen)
    return np.stack([np.asarray(channel, np.float32) for channel in channels], axis=-1)


def _surroundings(rgb: np.ndarray, away: np.ndarray, angle: np.ndarray, *, seen: np.ndarray) -> list[np.ndarray]:
    """What a network would learn from the image, by hand: contrasts, exposure, and what neighbouring lines see."""
    grey = rgb.mean(-1)
    # Of ln range, so that the spread on a slanted surface is the same near and far.
    logarithm = np.log(np.maximum(away, 1))
    channels = []
    for size in NEIGHBOURHOODS:
        channels += [*_mean_and_spread(grey, seen, size), _mean_and_spread(logarithm, seen, size)[1]]
        channels.append(cv2.blur(seen.astype(np.float32), (size, size)))
    # Incidence, red against blue, green against grey: what brightness does not tell.
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
    # float64: the variance below is a difference of nearly equal squares.
    blur = lambda x: cv2.blur(np.where(seen, x, 0).astype(np.float64), (size, size))  # noqa: E731
    # OpenCV averages over the whole square; over the share that is seen, it is the mean of seen cells.
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
