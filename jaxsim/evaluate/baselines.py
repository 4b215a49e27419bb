"""What a network must beat: predictors that are fitted to the same training frames and see no more than it does.

global, row mean      one number for all cells, one a laser line
median, row median    the same, by what the absolute error asks for
table                 the median of the cell's line, range and angle of incidence: a sensor model without a camera
trees                 boosted trees of each cell alone, and with its surroundings by hand (`trees`)
previous frame        the last measured frame, copied
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Pair
from jaxsim.metrics.paired import DROP_BELOW, Cells, group_means, group_medians

CLASSES = 34
PLACES = 64
"""Lines that the table tells apart, as the network's `beam` does."""
RANGES_M = np.array([3, 4, 5, 6, 7.5, 9, 11, 13, 16, 20, 25, 32, 42, 60])
ANGLES_RAD = np.deg2rad([20, 40, 55, 65, 72, 78, 82, 86])
ENOUGH = 30
"""Training cells below which a cell of the table takes its line's median."""


class Guess(NamedTuple):
    """What a baseline says of each cell of a window."""

    intensity: Float[np.ndarray, "rows columns"]
    drops: Bool[np.ndarray, "rows columns"]


Baseline = Callable[[Pair], Guess]
Group = Callable[[Pair], Int[np.ndarray, "rows columns"]]


def row_of(pair: Pair) -> Int[np.ndarray, "rows columns"]:
    """The cell's row in the window."""
    return np.broadcast_to(np.arange(len(pair.target))[:, None], pair.target.shape)


def table_of(pair: Pair) -> Int[np.ndarray, "rows columns"]:
    """The cell's place in the table of line, range and incidence."""
    line = np.round(np.asarray(pair.row) * (PLACES - 1)).astype(int)
    away = np.searchsorted(RANGES_M, np.asarray(pair.painted.range_m))
    angle = np.searchsorted(ANGLES_RAD, np.asarray(pair.incidence_rad))
    return (line * (len(RANGES_M) + 1) + away) * (len(ANGLES_RAD) + 1) + angle


TABLE = PLACES * (len(RANGES_M) + 1) * (len(ANGLES_RAD) + 1)


def everywhere(pair: Pair) -> Int[np.ndarray, "rows columns"]:
    """One group of all cells."""
    return np.zeros(pair.target.shape, int)


def class_of(pair: Pair) -> Int[np.ndarray, "rows columns"]:
    """The class that the camera paints on the cell."""
    return np.clip(np.asarray(pair.painted.semantic), 0, CLASSES - 1)


def fit_baselines(train: Sequence[Pair], judged: Sequence[Pair] = ()) -> dict[str, Baseline]:
    """The baselines that tables of training cells give; `judged` may have windows of more rows.

    Raises ValueError where no training cell is both seen and returned.
    """
    rows = max(len(pair.target) for pair in [*train, *judged])
    groups: dict[str, tuple[Group, int]] = {"global mean": (everywhere, 1)}
    if any((pair.painted.semantic > 0).any() for pair in train):
        groups["per-class mean"] = class_of, CLASSES
    groups["per-row mean"] = row_of, rows
    fitted = {
        name: _of_groups(group, *group_means(_cells(train, group), count)) for name, (group, count) in groups.items()
    }
    medians = {"global median": (everywhere, 1), "per-row median": (row_of, rows)}
    of = {name: group_medians(_cells(train, group), count) for name, (group, count) in medians.items()}
    fitted |= {name: _of_groups(group, of[name].intensity, of[name].drops) for name, (group, _) in medians.items()}
    fitted["range, incidence, row"] = _of_table(train, fitted["per-row median"])
    return fitted


def _of_groups(group: Group, intensity: Float[np.ndarray, " n"], drops: Bool[np.ndarray, " n"]) -> Baseline:
    values = intensity.astype(np.float32)
    return lambda pair: Guess(values[group(pair)], drops[group(pair)])


def _of_table(train: Sequence[Pair], otherwise: Baseline) -> Baseline:
    table = group_medians(_cells(train, table_of), TABLE)
    values = table.intensity.astype(np.float32)
    # A median of few cells is noise: the line's own is the better guess.
    known = table.count >= ENOUGH

    def guess(pair: Pair) -> Guess:
        place, row = table_of(pair), otherwise(pair)
        inside = known[place]
        return Guess(np.where(inside, values[place], row.intensity), np.where(inside, table.drops[place], row.drops))

    return guess


def previous_frame(before: Pair, filling: float) -> Guess:
    """The measured frame before, copied cell by cell; where it has no return, `filling` stands in."""
    measured = before.measured
    intensity = np.where(measured.valid, measured.intensity, np.float32(filling))
    return Guess(intensity, ~measured.valid | (measured.intensity < DROP_BELOW))


def _cells(pairs: Iterable[Pair], group: Group) -> Iterable[Cells]:
    for pair in pairs:
        yield pair.measured.intensity, pair.measured.valid, pair.painted.valid, group(pair)
