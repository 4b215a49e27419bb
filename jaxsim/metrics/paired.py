"""Scores of predicted intensity against the measurement, cell by cell.

x predicted, y measured intensity (0..1), m the cells that count. A cell is a *drop* where nothing came back
or where the reported intensity rounds to 0: the paper drops both alike.

What a prediction must beat are averages of the training frames: a baseline guesses one intensity a group (all cells,
a class, a row), and guesses that the group drops where more than half of its training cells dropped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.frame import LOST_BELOW, Array
from jaxsim.metrics.intervals import jackknife_interval, ratio_interval


class Score(NamedTuple):
    """One figure: its value, its unit and the number of cells behind it."""

    value: float
    unit: str
    count: int


def _blur(x: Array, window: Array) -> Array:
    """Separable window over the last two axes, zero outside."""
    half = window.shape[0] // 2
    for axis in (-1, -2):
        pad = [(0, 0)] * x.ndim
        pad[axis] = (half, half)
        padded = jnp.pad(x, pad)
        x = sum(
            w * jax.lax.slice_in_dim(padded, k, k + x.shape[axis], axis=axis % x.ndim) for k, w in enumerate(window)
        )
    return x


@jax.jit
def ssim_map(
    x: Float[Array, "*b rows columns"], y: Float[Array, "*b rows columns"], m: Bool[Array, "*b rows columns"]
) -> Float[Array, "*b rows columns"]:
    """Structural similarity in which cells outside `m` have no weight; 0 outside `m`.

    Gaussian window of 11 cells, sigma 1.5, K = (0.01, 0.03), data range 1 (Wang et al. 2004, eq. 13); each
    local moment is normalised by the window's weight on valid cells.
    """
    offsets = jnp.arange(11, dtype=jnp.float32) - 5
    window = jnp.exp(-0.5 * (offsets / 1.5) ** 2)
    window = window / window.sum()
    weight = m.astype(jnp.float32)
    x, y = jnp.where(m, x, 0.0), jnp.where(m, y, 0.0)
    # At least 1e-6: where no cell of the window counts, 0 / 0 becomes 0, and the mask leaves it out.
    total = jnp.maximum(_blur(weight, window), 1e-6)
    mean_x = _blur(x, window) / total
    mean_y = _blur(y, window) / total
    xx = _blur(x * x, window) / total
    yy = _blur(y * y, window) / total
    xy = _blur(x * y, window) / total
    # Differences of near equals in float32: no variance is below 0, and no covariance beyond what they allow.
    var_x = jnp.maximum(xx - mean_x**2, 0.0)
    var_y = jnp.maximum(yy - mean_y**2, 0.0)
    most = jnp.sqrt(var_x * var_y)
    covariance = jnp.clip(xy - mean_x * mean_y, -most, most)
    c1, c2 = 0.01**2, 0.03**2  # K squared, data range 1
    similarity = ((2 * mean_x * mean_y + c1) * (2 * covariance + c2)) / (
        (mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2)
    )
    return jnp.where(m, similarity, 0.0)


@jax.jit
def paired_sums(
    x: Float[Array, "*b rows columns"],
    guess: Bool[Array, "*b rows columns"],
    y: Float[Array, "*b rows columns"],
    *,
    returned: Bool[Array, "*b rows columns"],
    m: Bool[Array, "*b rows columns"],
) -> dict[str, Array]:
    """Sums that add up over frames, for `paired_scores`.

    `guess` are the cells predicted to drop, `returned` those whose beam came back. The intensity error counts
    every returned cell, also where the prediction drops it.
    """
    both = m & returned
    error = jnp.where(both, x - y, 0.0)
    dropped = ~returned | (y < LOST_BELOW)
    return {
        "cells": both.sum(),
        "absolute": jnp.abs(error).sum(),
        "squared": (error**2).sum(),
        "similarity": ssim_map(x, y, both).sum(),
        "drop_hits": (m & dropped & guess).sum(),
        "drop_guesses": (m & guess).sum(),
        "drop_truths": (m & dropped).sum(),
        "seen": m.sum(),
    }


def paired_scores(sums: dict[str, Array]) -> dict[str, Score]:
    """Scores from the sums of one or many frames.

    mae, rmse (intensity 0..1), psnr (dB, peak 1) and ssim over cells that the camera saw and whose beam came
    back; drop_iou and drop_f1 over all cells that the camera saw. Raises ValueError where no cell counts.
    """
    s = {key: float(value) for key, value in sums.items()}
    n, seen = int(s["cells"]), int(s["seen"])
    if n == 0:
        raise ValueError("paired: no cell is both seen by the camera and returned; check calibration and range limits")
    # Means over all cells of all frames, not means of the frames' means: a frame with few returns weighs little.
    mse = s["squared"] / n
    drops = s["drop_guesses"] + s["drop_truths"]
    # |A or B| = |A| + |B| - |A and B|.
    union = drops - s["drop_hits"]
    nothing = float("nan")
    return {
        "mae": Score(s["absolute"] / n, "intensity", n),
        "rmse": Score(mse**0.5, "intensity", n),
        "psnr": Score(-10 * float(jnp.log10(mse)) if mse else float("inf"), "dB", n),
        "ssim": Score(s["similarity"] / n, "1", n),
        "drop_iou": Score(s["drop_hits"] / union if union else nothing, "1", seen),
        "drop_f1": Score(2 * s["drop_hits"] / drops if drops else nothing, "1", seen),
    }


class GroupLevels(NamedTuple):
    """What the cells of each group do."""

    mean: Float[np.ndarray, " groups"]
    """Of the group's returns, 0..1."""
    median: Float[np.ndarray, " groups"]
    """Of the group's returns, which the absolute error asks for."""
    drops: Bool[np.ndarray, " groups"]
    """Most of the group's cells drop."""
    count: Int[np.ndarray, " groups"]
    """Returns of the group."""


def group_levels(
    intensity: Float[np.ndarray, " n"], returned: Bool[np.ndarray, " n"], group: Int[np.ndarray, " n"], *, groups: int
) -> GroupLevels:
    """Averages of training cells, each with its intensity (0..1) and its group (0..groups-1).

    A group without a return takes the averages of all. Raises ValueError where no cell returned.
    """
    if not returned.any():
        raise ValueError("baselines: no training cell is both seen by the camera and returned")
    value, index = intensity[returned], group[returned]
    value, count = value[np.lexsort((value, index))], np.bincount(index, minlength=groups)
    # Sorted by group and value, a group's median is the mean of its one or two middle values.
    first = np.cumsum(count) - count
    low, high = first + np.maximum(count - 1, 0) // 2, first + count // 2
    last = len(value) - 1
    middle = (value[np.minimum(low, last)] + value[np.minimum(high, last)]) / 2
    total = np.bincount(index, intensity[returned], groups)
    dropped = np.bincount(group[~returned | (intensity < LOST_BELOW)], minlength=groups)
    return GroupLevels(
        mean=np.where(count > 0, total / np.maximum(count, 1), total.sum() / count.sum()),
        median=np.where(count > 0, middle, np.median(value)),
        drops=dropped > 0.5 * np.bincount(group, minlength=groups),
        count=count,
    )


def frame_sums(
    x: Float[Array, "rows columns"], guess: Bool[Array, "rows columns"], *, y: Array, returned: Array, m: Array
) -> dict[str, float]:
    """`paired_sums` of one frame as plain numbers."""
    return {key: float(value) for key, value in paired_sums(x, guess, y, returned=returned, m=m).items()}


def total_scores(frames: Sequence[Mapping[str, float]]) -> dict[str, Score]:
    """`paired_scores` of many frames' sums."""
    return paired_scores({key: sum(frame[key] for frame in frames) for key in frames[0]})


def scene_intervals(frames: Sequence[Mapping[str, float]], scenes: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Interval of each score over scenes, by the jackknife: what it becomes without each of them.

    No interval where there are fewer than two scenes in which anything is scored.
    """
    names = _scored_scenes(frames, scenes)
    if len(names) < 2:
        return {}
    # Leaving a scene out costs a sum: no cell is looked at again.
    rest = [[f for f, scene in zip(frames, scenes, strict=True) if scene != name] for name in names]
    without = [total_scores(frames) for frames in rest]
    values = total_scores(frames)
    return {
        name: jackknife_interval(score.value, np.array([w[name].value for w in without]))
        for name, score in values.items()
    }


def _scored_scenes(frames: Sequence[Mapping[str, float]], scenes: Sequence[str]) -> list[str]:
    """The scenes with a cell to score: others say nothing of how scenes scatter, and would count as scatter of 0."""
    return sorted({scene for frame, scene in zip(frames, scenes, strict=True) if frame["cells"]})


def difference_of(
    first: Sequence[Mapping[str, float]], second: Sequence[Mapping[str, float]], scenes: Sequence[str]
) -> tuple[float, float, float]:
    """Mean absolute error of `first` minus that of `second` on the same cells, and its interval over scenes (NaN where
    there are fewer than two): paired, as scenes that are hard for one are hard for the other."""
    names = _scored_scenes(first, scenes)
    of = {name: [i for i, scene in enumerate(scenes) if scene == name] for name in names}
    top = np.array([sum(first[i]["absolute"] - second[i]["absolute"] for i in of[name]) for name in names])
    cells = np.array([sum(first[i]["cells"] for i in of[name]) for name in names])
    return float(top.sum() / cells.sum()), *ratio_interval(top, cells)
