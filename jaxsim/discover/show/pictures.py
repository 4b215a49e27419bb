"""What a report draws of judge scenes: residuals along the named effects' own covariates and on the polar grid, and
their frames ray by ray (whole ones, where the judging itself looks at few columns).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.find.covariates import COVARIATES
from jaxsim.discover.find.division import Division
from jaxsim.discover.model.cast import Blocks, blocks
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.null_model import Residuals, residuals
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import CurveLine, JudgeFrame
from jaxsim.discover.verdict.names import CATEGORICAL, MAP_COLUMNS
from jaxsim.effects import Law
from jaxsim.frame import PolarGrid
from jaxsim.metrics.intervals import half_width

RESIDUAL_UNITS = {
    "intensity": "ln I, measured minus simulated",
    "range": "m, measured minus simulated",
    "drop": "share lost, measured minus expected",
}
SPREAD_UNIT = "spread over the one expected, less 1"
CURVE_BINS = 16
"""Groups of a covariate along which a curve is drawn."""
MOST_FRAMES = 4
"""Frames that are drawn, of as many judge scenes."""
RAYS_A_FRAME = 16_000
"""Rays of each, about, if it has so many: whole columns, evenly spread."""


def residual_curves(
    before: Problem,
    after: Problem,
    *,
    in_fit: Float[np.ndarray, " b"],
    scene: Int[np.ndarray, " b"],
    effects: Sequence[Law],
) -> tuple[CurveLine, ...]:
    """Mean residual along each named effect's own covariates, on the blocks that are not fitted; where an effect makes
    ranges scatter, also the residuals' spread over the one that each ray is expected to have, for their mean shows
    nothing of it. `scene` is that of each block."""
    judged = np.asarray(in_fit) == 0
    wanted = {
        (channel, covariate): None
        for effect in effects
        for channel in effect.channels
        for covariate in effect.covariates
        if covariate in COVARIATES
    }
    old = residuals(before, in_fit)
    new = residuals(after, in_fit)
    rays = jax.tree.map(lambda leaf: np.asarray(leaf)[judged] if np.ndim(leaf) else leaf, before.ev.rays)
    # Of an effect that only makes ranges scatter no mean shows anything.
    scatters = bool((np.asarray(after.ev.rays.noise_m) > np.asarray(before.ev.rays.noise_m)).any())
    lines = []
    for channel, covariate in wanted:
        counts = old[channel][2][judged] & new[channel][2][judged]
        if counts.sum() < RULES.fewest_curve_rays:
            continue
        of_scene = np.broadcast_to(scene[judged][:, None, None], counts.shape)[counts]
        bins = Bins.of(np.asarray(COVARIATES[covariate](rays), float)[counts], covariate, of_scene)
        if bins is None:
            continue
        sides = [[part[judged][counts] for part in side[channel][:2]] for side in (old, new)]
        means = [off for off, _ in sides]
        unit = RESIDUAL_UNITS[channel]
        lines.append(CurveLine(channel, covariate, unit, bins.centre, *bins.curve(*means), edges=bins.edges))
        if scatters and channel == "range":
            # z has a variance of 1 where the noise is what the model expects; its square shows by how much it is not.
            squares = [z**2 for _, z in sides]
            spread = bins.curve(*squares, shown=lambda mean: np.sqrt(mean) - 1)
            lines.append(
                CurveLine(channel, covariate, SPREAD_UNIT, bins.centre, *spread, spread=True, edges=bins.edges)
            )
    return tuple(lines)


@dataclass(frozen=True)
class Bins:
    """Rays in groups of about the same covariate (k groups)."""

    index: Int[np.ndarray, " n"]
    """The group of each ray."""
    scene: Int[np.ndarray, " n"]
    centre: Float[np.ndarray, " k"]
    edges: Float[np.ndarray, " k+1"]

    @classmethod
    def of(cls, x: Float[np.ndarray, " n"], covariate: str, scene: Int[np.ndarray, " n"]) -> Bins | None:
        """One group a beam or class; of other covariates, as many rays in each. None where all rays are alike."""
        if covariate in CATEGORICAL:
            # The last category is closed by infinity, as a bin needs two ends.
            edges = np.array([*np.unique(x), np.inf])
        else:
            # Ties make quantiles equal, and such groups are one.
            edges = np.unique(np.quantile(x, np.linspace(0, 1, CURVE_BINS + 1)))
        if len(edges) < 3:
            return None
        size = len(edges) - 1
        index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, size - 1)
        centre = np.bincount(index, x, size) / np.maximum(np.bincount(index, minlength=size), 1)
        return cls(index, scene, centre, edges)

    def mean(self, values: Float[np.ndarray, " n"], *, of: slice | np.ndarray = slice(None)) -> Float[np.ndarray, " k"]:
        """Mean of each group, of some rays; NaN where there is none."""
        count = np.bincount(self.index[of], minlength=len(self.centre))
        total = np.bincount(self.index[of], values[of], len(self.centre))
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    def curve(
        self,
        before: Float[np.ndarray, " n"],
        after: Float[np.ndarray, " n"],
        *,
        shown: Callable[[np.ndarray], np.ndarray] = lambda mean: mean,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Means before and after, as they are `shown`, and the half width of the 90 % interval of the former."""
        scenes = np.array([shown(self.mean(before, of=self.scene == number)) for number in np.unique(self.scene)])
        return shown(self.mean(before)), shown(self.mean(after)), half_width(scenes)


def residual_maps(problem: Problem, *, in_fit: Float[np.ndarray, " b"]) -> dict[str, Float[np.ndarray, "r c"]]:
    """Mean residual of the blocks that are not fitted, on the grid, by channel."""
    return {name: sums.mean() for name, sums in map_sums(problem, in_fit, where=np.asarray(in_fit) == 0).items()}


def map_sums(
    problem: Problem, in_fit: Float[np.ndarray, " b"], *, where: Bool[np.ndarray, " b"]
) -> dict[str, GridSums]:
    """Sums of the residuals of some blocks on the grid, by channel."""
    row = np.asarray(problem.ev.rays.row)
    column = np.asarray(problem.ev.rays.column)
    sums = {}
    for name, (off, _, counts) in residuals(problem, in_fit).items():
        keep = counts & where[:, None, None]
        sums[name] = GridSums.of(off[keep], (row[keep], column[keep]), problem.scan.grid)
    return sums


@dataclass(frozen=True)
class GridSums:
    """Rays of each row and of each of at most MAP_COLUMNS groups of columns."""

    total: Float[np.ndarray, "r g"]
    count: Int[np.ndarray, "r g"]
    columns: int
    """How many the grid has."""

    @classmethod
    def of(cls, values: Float[np.ndarray, " n"], cells: tuple[np.ndarray, np.ndarray], grid: PolarGrid) -> GridSums:
        """Sums of rays in the `cells` (rows and columns) of a grid."""
        rows, columns = len(grid.elevation_rad), len(grid.azimuth_rad)
        bins = min(columns, MAP_COLUMNS)
        row, column = cells
        # Cells numbered row by row, so that one count serves all.
        cell = row * bins + column * bins // columns
        count = np.bincount(cell, minlength=rows * bins).reshape(rows, bins)
        total = np.bincount(cell, values, minlength=rows * bins).reshape(rows, bins)
        return cls(total, count, columns)

    def __add__(self, other: GridSums) -> GridSums:
        return GridSums(self.total + other.total, self.count + other.count, self.columns)

    def mean(self) -> Float[np.ndarray, "r c"]:
        """Means, spread over the grid; NaN where there is no ray."""
        mean = np.where(self.count > 0, self.total / np.maximum(self.count, 1), np.nan)
        return mean[:, np.arange(self.columns) * mean.shape[1] // self.columns]


@dataclass(frozen=True)
class Chunk:
    """A division with columns of the drawn frames in place of what it judges on."""

    division: Division
    frame: Int[np.ndarray, " j"]
    """For each judge block the frame whose columns each holds, and its scene; -1 where it only fills up."""
    scene: tuple[str, ...]


def whole_frames(division: Division) -> Iterator[Chunk]:
    """Nearly all columns of a few judge frames, as many blocks at a time as there are to judge on: the middle frame of
    each of some judge scenes, spread evenly over them; of a single drive's sectors, frames spread over the drive.

    Columns stay in blocks of as many as before, each spread over its frame, so that a block's own levels and pose mean
    what they mean where scenes are judged. And the shapes stay, so that nothing is compiled again.
    """
    old = division.blocks
    frames, rows, columns = division.scan.range_m.shape
    whole = blocks(division.scenes, rows, columns, rays=rows * columns * frames)
    judge = division.parts.judge
    shown = _shown_frames(whole, judge)
    picked = [k for k in range(len(whole.frame)) if whole.frame[k] in shown and whole.scene[k] in judge]
    most = RAYS_A_FRAME * len(shown) / rows / len(picked)
    column = [_in_blocks(whole.column[k], old.column.shape[1], most=most) for k in picked]
    block_of = np.repeat(picked, [len(c) for c in column])
    columns_of = np.concatenate(column)
    places = np.flatnonzero([scene in judge for scene in old.scene])
    for first in range(0, len(block_of), len(places)):
        take = np.arange(first, first + len(places))
        fills = take >= len(block_of)
        take = np.where(fills, 0, take)
        frame = old.frame.copy()
        frame[places] = whole.frame[block_of[take]]
        column_now = old.column.copy()
        column_now[places] = columns_of[take]
        # Scenes keep their places: nothing of these blocks is summed over scenes.
        part = division.looking_at(replace(old, frame=frame, column=column_now))
        names = tuple(whole.scene[k] for k in block_of[take])
        yield Chunk(part, np.where(fills, -1, frame[places]), names)


def _shown_frames(whole: Blocks, judge: Sequence[str]) -> set[int]:
    """The frames that are drawn, by number."""
    of_scene = {
        name: [f for f, s in zip(whole.frame.tolist(), whole.scene, strict=True) if s == name] for name in judge
    }
    if all(frames == of_scene[judge[0]] for frames in of_scene.values()):
        # Sectors of one drive: every frame holds all of them.
        frames = of_scene[judge[0]]
        return {frames[k] for k in _spread(len(frames))}
    middles = [frames[len(frames) // 2] for frames in of_scene.values()]
    return {middles[k] for k in _spread(len(middles))}


def _spread(count: int) -> list[int]:
    """At most MOST_FRAMES numbers, even steps through 0 to count - 1."""
    return sorted({*np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(int).tolist()})


def _in_blocks(column: Int[np.ndarray, " n"], each: int, *, most: float) -> Int[np.ndarray, "m {each}"]:
    """Columns in blocks of `each`, every block spread over all; every second, third ... of them if more than `most`."""
    # As many columns as a block has are always left.
    step = min(-(-len(column) // max(int(most), each)), len(column) // each)
    thinned = column[:: max(1, step)]
    count = len(thinned) // each
    return thinned[: count * each].reshape(each, count).T


def rays_of(
    before: Problem, after: Problem, *, in_fit: Float[np.ndarray, " b"], chunk: Chunk, curves: Sequence[CurveLine]
) -> Iterator[JudgeFrame]:
    """The rays of a chunk with the residuals of both problems, a JudgeFrame a block."""
    judged = np.asarray(in_fit) == 0
    old = residuals(before, in_fit)
    new = residuals(after, in_fit)
    rays = jax.tree.map(lambda leaf: np.asarray(leaf)[judged] if np.ndim(leaf) else leaf, before.ev.rays)
    groups = [
        np.where(old[curve.channel].counts[judged], curve.group_of(np.asarray(COVARIATES[curve.covariate](rays))), -1)
        for curve in curves
    ]
    returned = np.asarray(before.ev.returned)[judged]
    off_before = _off(old, judged)
    off_after = _off(new, judged)
    range_m = np.where(returned, np.asarray(before.ev.range_m)[judged], np.asarray(rays.range_m))
    # A ray that hits nothing and brought nothing has no place.
    placed = np.isfinite(range_m) & (range_m > 0)
    for k, number in enumerate(chunk.frame):
        if number < 0:
            continue
        keep = placed[k]
        yield JudgeFrame(
            name=chunk.division.names[number],
            scene=chunk.scene[k],
            row=np.asarray(rays.row)[k][keep],
            column=np.asarray(rays.column)[k][keep],
            range_m=range_m[k][keep],
            returned=returned[k][keep],
            before={name: off[k][keep] for name, off in off_before.items()},
            after={name: off[k][keep] for name, off in off_after.items()},
            groups=tuple(group[k][keep] for group in groups),
            time_s=float(np.asarray(before.scan.time_s)[number]),
        )


def _off(by_channel: Mapping[str, Residuals], judged: Bool[np.ndarray, " b"]) -> dict[str, Float[np.ndarray, "k c r"]]:
    """Residuals of the judged blocks, NaN where nothing is compared."""
    return {name: np.where(r.counts, r.off, np.nan)[judged].astype(np.float32) for name, r in by_channel.items()}


def joined(parts: Sequence[JudgeFrame]) -> JudgeFrame:
    """Parts of one frame as one; without a scene where they are of several."""

    def together(each: Sequence[Any]) -> Any:
        if isinstance(each[0], dict):
            return {name: together([part[name] for part in each]) for name in each[0]}
        if isinstance(each[0], tuple):
            return tuple(map(together, zip(*each, strict=True)))
        return np.concatenate(each)

    of_rays = ("row", "column", "range_m", "returned", "before", "after", "groups")
    rays = {name: together([getattr(part, name) for part in parts]) for name in of_rays}
    scene = parts[0].scene if len({part.scene for part in parts}) == 1 else ""
    return replace(parts[0], scene=scene, **rays)
