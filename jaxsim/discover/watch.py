"""How a sensor changes over days: its own frames of today against its own of before, whatever the streets.

A street decides how bright and how far everything is; dirt on the window, a dying beam and a drifting emitter show in
what a row or a sector has beside the rest of its frame. So rows and sectors are held against their own frame's median,
scene by scene, and days against each other by how far chance sets scenes apart. The road under the sensor is where it
was, unless the sensor's ranges, its height or its tilt are not. A frame after the other is read and forgotten.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.data.polar_frames import PolarFrames, open_polar_frames, scene_of
from jaxsim.discover.read.checks import check_units
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import ROUNDING, orders_of, scene_means
from jaxsim.frame import PolarGrid, PolarImage
from jaxsim.geometry import grid_difference


@dataclass(frozen=True)
class Change:
    """What is not as it was, on one day."""

    what: str
    """`row 12`, `sector 3 (from 60 to 90 degrees)`, `all`, or `the road`."""
    channel: str
    """intensity, returns, or range, which is the road's."""
    value: float
    """Today less before: of intensity and range in nats, of returns as a share of rays."""
    low: float
    high: float
    """Its interval, so wide that `Rules.watch_chance` holds for all questions of a day together."""


@dataclass(frozen=True)
class Day:
    """A folder of one day."""

    folder: Path
    scenes: int
    changes: tuple[Change, ...]


def watch_days(before: Path, days: Sequence[Path]) -> tuple[Day, ...]:
    """What has changed on each day since `before`, the strongest first.

    Raises ValueError where folders are not of one sensor (another grid), and for days of fewer than
    `Rules.fewest_for_scatter` scenes.
    """
    grid, base = scene_table(before)
    names = measure_names(grid)
    rows = []
    for folder in days:
        other, table = scene_table(folder)
        if difference := grid_difference(grid, other):
            raise ValueError(f"watch: {folder} is of another sensor than {before}: they differ in {difference}")
        rows.append(Day(folder, len(table), changes(base, table, names)))
    return tuple(rows)


def scene_table(folder: Path) -> tuple[PolarGrid, Float[np.ndarray, "s k"]]:
    """What is asked of a folder's frames: a row a scene, the mean of its frames. NaN where a row saw nothing."""
    frames = open_polar_frames(folder)
    road = np.asarray(frames.grid.elevation_rad) <= -RULES.watch_road_rad
    table = scene_means((scene_of(name, frames), measures(_read(frames, name), road)) for name in frames.names)
    if len(table) < RULES.fewest_for_scatter:
        raise ValueError(
            f"watch: {folder} has {len(table)} scenes; {RULES.fewest_for_scatter} are needed to know how much "
            "streets differ (frames without a scene in grid.json are scenes of their own)"
        )
    return frames.grid, table


def _read(frames: PolarFrames, name: str) -> PolarImage:
    image, _ = frames.read(name)
    if np.asarray(image.valid).any():  # a sensor that sees nothing any more has changed
        check_units(name, image, str(frames.folder))
    return image


def measures(image: PolarImage, road: Bool[np.ndarray, " rows"]) -> Float[np.ndarray, " k"]:
    """Log intensity and share of returns of a frame, and of its rows and sectors beside the median of these: one that
    changes does not move the others; last the log range of the road, which the rows `road` see."""
    valid = np.asarray(image.valid)
    log_intensity = np.log(np.maximum(np.asarray(image.intensity), RULES.watch_least))
    # The whole frame, then its rows, then its sectors: the order of `measure_names`.
    parts = [valid, *valid, *_sectors(valid)]
    values = [log_intensity, *log_intensity, *_sectors(log_intensity)]
    share = np.array([part.mean() for part in parts])
    level = np.array([v[part].mean() if part.any() else np.nan for v, part in zip(values, parts, strict=True)])
    for line in (share, level):
        for part in (line[1 : len(valid) + 1], line[len(valid) + 1 :]):
            # A view: the median goes off the frame's own numbers.
            part -= np.nanmedian(part) if np.isfinite(part).any() else 0.0
    return np.concatenate([level, share, [_log_road(np.asarray(image.range_m)[road], valid[road])]])


def _sectors(cells: np.ndarray) -> list[np.ndarray]:
    """The parts of the columns (the last axis) that are watched; of a grid with fewer columns one part each."""
    return np.array_split(cells, min(RULES.watch_sectors, cells.shape[-1]), axis=-1)


def _log_road(range_m: Float[np.ndarray, "rows columns"], valid: Bool[np.ndarray, "rows columns"]) -> float:
    """Mean over rows of the log of the road's range; NaN where a row returns nothing, or none sees the road."""
    if not len(valid) or not valid.any(axis=1).all():
        return np.nan
    far = np.nanquantile(np.where(valid, range_m, np.nan), RULES.watch_road_quantile, axis=1)
    return float(np.log(far).mean())


def measure_names(grid: PolarGrid) -> list[tuple[str, str]]:
    """Name and channel of each number of `measures`."""
    degrees = np.rad2deg(np.asarray(grid.azimuth_rad))
    edges = [(part[0], part[-1]) for part in _sectors(degrees)]
    sectors = [f"sector {k} (from {left:.0f} to {right:.0f} degrees)" for k, (left, right) in enumerate(edges)]
    names = ["all", *(f"row {k}" for k in range(len(grid.elevation_rad))), *sectors]
    return [*((name, channel) for channel in ("intensity", "returns") for name in names), ("the road", "range")]


def changes(
    before: Float[np.ndarray, "s k"], today: Float[np.ndarray, "t k"], names: Sequence[tuple[str, str]]
) -> tuple[Change, ...]:
    """The questions whose answers differ between two days by more than chance makes one of them differ when the scenes
    are dealt out to the days anew (max-T, Westfall & Young 1993): streets scatter by laws of their own, and a few of
    them may by chance scatter little."""
    known = np.stack([np.isfinite(day).sum(0) for day in (before, today)])
    asked = np.flatnonzero((known >= RULES.fewest_for_scatter).all(0))
    if not asked.size:
        return ()
    apart = Apart.of(np.concatenate([today, before])[:, asked])
    is_today = np.arange(len(apart.off)) < len(today)
    differences, strength = apart.differences(is_today[None])
    by_chance = apart.differences(orders_of(len(apart.off)) < len(today))[1].max(1)
    # Of so many draws the strongest, with what was measured one more: one beyond it is rarer than the chance allowed.
    beyond = int(RULES.watch_chance * (1 + len(by_chance))) - 1
    limit = np.sort(by_chance)[-1 - beyond]
    half = apart.half_width(is_today, limit)
    changed = []
    for k in np.flatnonzero(strength[0] > limit + ROUNDING):
        value, reach = float(differences[0, k]), float(half[k])
        # Ranked in units of scatter: nats and shares do not compare.
        rank = abs(value) / max(2 * reach, RULES.watch_least)
        changed.append((rank, Change(*names[asked[k]], value=value, low=value - reach, high=value + reach)))
    return tuple(change for _, change in sorted(changed, key=lambda pair: -pair[0]))


@dataclass(frozen=True)
class Apart:
    """Scenes of two days together, by which it is asked how far groups of them lie apart."""

    off: Float[np.ndarray, "n k"]
    """Numbers less the mean of all scenes; 0 where unknown."""
    known: Bool[np.ndarray, "n k"]

    @classmethod
    def of(cls, numbers: Float[np.ndarray, "n k"]) -> Apart:
        known = np.isfinite(numbers)
        off = np.where(known, numbers - np.nanmean(numbers, axis=0), 0)
        # Equal shares differ by rounding, which is no scatter.
        return cls(np.where(np.abs(off) < ROUNDING, 0, off), known)

    def differences(self, chosen: Bool[np.ndarray, "d n"]) -> tuple[Float[np.ndarray, "d k"], Float[np.ndarray, "d k"]]:
        """Mean of the chosen scenes less that of the others, for each choice; and its size in units of what the scatter
        of all makes it vary by, 0 where either group knows nothing."""
        sums = chosen @ self.off
        across = self._across(chosen)
        scatter = np.sqrt((self.off**2).sum(0) / np.maximum(self.known.sum(0) - 1, 1))
        # The numbers of all have mean 0, so that the others' sum is the chosen ones' with the other sign.
        return sums * across, np.abs(sums) * np.sqrt(across) / np.where(scatter > 0, scatter, np.inf)

    def half_width(self, chosen: Bool[np.ndarray, " n"], limit: float) -> Float[np.ndarray, " k"]:
        """Half the width of each difference's interval: the differences that, taken off, leave no more than `limit`."""
        across = self._across(chosen[None])[0]
        difference, _ = self.differences(chosen[None])
        within = np.maximum((self.off**2).sum(0) - difference[0] ** 2 / np.maximum(across, ROUNDING), 0)
        # What is taken off lowers the scatter of all as well: hence the limit in the denominator.
        left = self.known.sum(0) - 1 - limit**2
        return np.where(left > 0, limit * np.sqrt(across * within / np.where(left > 0, left, 1)), np.inf)

    def _across(self, chosen: Bool[np.ndarray, "d n"]) -> Float[np.ndarray, "d k"]:
        """1 / n + 1 / m of the known scenes of both groups; 0 where either has none."""
        inside = chosen @ self.known.astype(float)
        outside = self.known.sum(0) - inside
        both = inside * outside
        return np.where(both > 0, (inside + outside) / np.where(both > 0, both, 1), 0)
