"""A simulator's contrast: how its intensities differ from those beside them, and within a class.

A law of the sensor bends readings one by one: its slope is the same for a surface against its neighbour, for two cells
of one surface, and for two classes. What a simulator has learned, or blurred, or made up is not: a network's fine
detail is too weak, and of the differences between surfaces of a class part is its own error, which the sensor does not
follow: a class holds several materials, each of which its table may have wrong, and crowns are of other leaves. So a
slope that depends on how far apart the compared cells are, or on their class, is the simulator's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import uniform_filter1d

from jaxsim.data.cityscapes import NAMES
from jaxsim.discover.model.cast import STEEPEST_COSINE, RayIndex
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict.names import SCALES
from jaxsim.effects.rays import FLOOR, LEAST_M, Scan
from jaxsim.frame import Array
from jaxsim.geometry import spans_turn

OF_NO_CLASS = ("dark_surfaces", "bright_surfaces")
"""Scales of frames that tell no classes: more of dark surfaces may be made up."""
FEWER_RAYS = "other_classes"
"""The scale of the classes that fewer rays show."""
MOST_CLASSES = 8
"""Classes that have a scale of their own, at most: those that most rays show."""
DARK_AND_BRIGHT = (0.1, 0.9)
"""Quantiles of what the simulator says, in ln I, up to which a surface is dark and from which it is bright; between
them it is partly both."""
PATCH_ROWS, PATCH_RAD = 5, np.deg2rad(8.0)
"""Half height and half width of a patch."""
MOST_CONTRAST = 1.0
"""Nats within which differences beside a cell are held: one dark cell tells no slope ..."""
MOST_OF_CLASS = 3.0
"""... and those within a class, which paint has over asphalt: held closer, what a table has wrong of it is a bend."""


class Contrasts(NamedTuple):
    """Differences of the simulated ln I."""

    scales: tuple[str, ...]
    nats: Float[np.ndarray, "b c r k"]
    """On each of the scales; 0 where a ray reads nothing."""


def contrast_of(scan: Scan, index: RayIndex, *, given_rad: Float[Array, "f r n"]) -> Contrasts:
    """The contrast at the chosen rays, on all scales: SCALES first, then those of classes."""
    within = within_classes(scan, index, given_rad=given_rad)
    return Contrasts((*SCALES, *within.scales), np.concatenate([_beside(scan, index), within.nats], axis=-1))


def within_classes(scan: Scan, index: RayIndex, *, given_rad: Float[Array, "f r n"]) -> Contrasts:
    """The contrast of cells over what is usual of their class; of dark and of bright surfaces where all are of one."""
    own = np.log(np.maximum(np.asarray(scan.intensity)[index], FLOOR))
    reads = _reads(scan)[index]
    semantic = np.asarray(scan.semantic)[index][reads]
    usual = class_trend(
        own[reads].astype(float),
        semantic=semantic,
        incidence_rad=np.asarray(given_rad)[index][reads],
        range_m=np.asarray(scan.range_m)[index][reads],
    )
    names, shares = _of_classes(semantic, usual)
    nats = np.zeros((*reads.shape, len(names)), np.float32)
    nats[reads] = np.clip(own[reads] - usual, -MOST_OF_CLASS, MOST_OF_CLASS)[:, None] * shares
    return Contrasts(names, nats)


def _of_classes(
    semantic: Int[np.ndarray, " n"], usual: Float[np.ndarray, " n"]
) -> tuple[tuple[str, ...], Float[np.ndarray, "n k"]]:
    """The scales of classes, and how much of each a ray is; `usual` is the ln I of its class at its angle and range."""
    kinds, counts = np.unique(semantic, return_counts=True)
    if len(kinds) < 2:
        dark, bright = np.quantile(usual, DARK_AND_BRIGHT) if len(usual) else (0.0, 1.0)
        share = np.clip((usual - dark) / max(bright - dark, 1e-6), 0, 1)
        return OF_NO_CLASS, np.stack([1 - share, share], axis=-1)
    most = np.argsort(-counts, kind="stable")[:MOST_CLASSES]
    own = np.sort(kinds[most][counts[most] >= RULES.fewest_of_class])
    shares = semantic[:, None] == own
    names = tuple(NAMES[int(kind)] for kind in own)
    rest = ~shares.any(-1)
    if not rest.any():
        return names, shares.astype(float)
    return (*names, FEWER_RAYS), np.column_stack([shares, rest]).astype(float)


def _reads(scan: Scan) -> Bool[np.ndarray, "f r n"]:
    """Whether a cell reads anything: without, it says nothing of those beside it."""
    return np.asarray(scan.hit) & (np.asarray(scan.intensity) > FLOOR)


def _beside(scan: Scan, index: RayIndex) -> Float[np.ndarray, "b c r k"]:
    """The contrast on SCALES."""
    light, counts = np.log(np.maximum(np.asarray(scan.intensity), FLOOR)), _reads(scan)
    azimuth = np.asarray(scan.grid.azimuth_rad, float)
    step = np.median(np.abs(np.angle(np.exp(1j * np.diff(azimuth)))))
    patch = PATCH_ROWS, max(2, round(PATCH_RAD / max(step, 1e-6)))
    turns = bool(spans_turn(scan.grid))
    reads, own = counts[index], light[index]
    contrast = np.zeros((*reads.shape, len(SCALES)), np.float32)
    places = np.asarray(index)
    # Frame by frame: the means of hundreds of frames would not fit beside these.
    for frame in np.unique(places[0]):
        of = places[0] == frame
        at = places[1][of], places[2][of]
        near = _mean_about(light[frame], counts[frame], (1, 1), turns=turns)
        far = _mean_about(light[frame], counts[frame], patch, turns=turns)
        contrast[of] = np.stack([own[of] - near[at], near[at] - far[at]], axis=-1)
    return np.where(reads[..., None], np.clip(contrast, -MOST_CONTRAST, MOST_CONTRAST), 0)


def _mean_about(
    x: Float[np.ndarray, "r n"], counts: Bool[np.ndarray, "r n"], half: tuple[int, int], *, turns: bool
) -> Float[np.ndarray, "r n"]:
    """The mean of x about each cell, so many rows and columns to each side, over cells that count."""

    def smooth(a: Float[np.ndarray, "r n"]) -> Float[np.ndarray, "r n"]:
        columns = min(2 * half[1] + 1, x.shape[1])
        of_rows = uniform_filter1d(a, 2 * half[0] + 1, axis=0, mode="constant")
        return uniform_filter1d(of_rows, columns, axis=1, mode="wrap" if turns else "constant")

    return smooth(np.where(counts, x, 0.0)) / np.maximum(smooth(counts.astype(float)), 1e-6)


def class_trend(
    level: Float[np.ndarray, " n"],
    *,
    semantic: Int[np.ndarray, " n"],
    incidence_rad: Float[np.ndarray, " n"],
    range_m: Float[np.ndarray, " n"],
    telling: Bool[np.ndarray, " n"] | None = None,
) -> Float[np.ndarray, " n"]:
    """What a simulator says of ln I, `level`, by class, angle and range, by the rays that are `telling` (default: all).
    At angles and ranges that these do not reach, what it says of the nearest that they do; 0 of a class without any."""
    telling = np.ones(len(level), bool) if telling is None else telling
    slant = np.log(np.maximum(np.cos(incidence_rad), STEEPEST_COSINE))
    far = np.log(np.maximum(range_m, LEAST_M))
    result = np.zeros(len(level))
    for kind in np.unique(semantic[telling]):
        of = semantic == kind
        tells = telling[of]
        # A class of few rays says nothing of angles.
        over = (slant, far) if tells.sum() >= RULES.fewest_of_class else ()
        columns = np.stack([np.ones(len(tells)), *(term for x in over for term in _bent(x[of], tells))], axis=-1)
        result[of] = columns @ np.linalg.lstsq(columns[tells], level[of][tells], rcond=None)[0]
    return result


def _bent(x: Float[np.ndarray, " n"], telling: Bool[np.ndarray, " n"]) -> Float[np.ndarray, "2 n"]:
    """The terms of a trend that may bend, held beyond what is told."""
    held = np.clip(x, x[telling].min(), x[telling].max())
    # Powers of the cosine and of the range are lines in logarithms; squares let them bend.
    return np.stack([held, held**2])
