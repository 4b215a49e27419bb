"""Fidelity a target: how many points a car, a sign or a patch of road has, and how bright it is, on both sides.

What a detector sees is points on targets; errors a ray may cancel there, or add up. A target is an object where the
simulated frames number them, else a patch of one class: what of it lies in a tile of the raster. Its measured points
are those of its rays that end within its own ranges. Rays that a simulator lost are a target's where it labels them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jaxsim.data.cityscapes import NAMES
from jaxsim.discover.read import Comparison
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Fidelity, Interval
from jaxsim.metrics.intervals import known_mean


def compare_objects(comparison: Comparison) -> tuple[Fidelity, ...]:
    """Errors of points and of mean intensity a target, by kind of target, those with most targets first; empty where
    the simulated frames have no classes.

    Errors are mean absolute percentages of the measured value: a mean over a scene's targets, then over scenes, with
    90 % intervals over these; and signed ones, which tell whether targets are too dense or too bright as a whole.
    """
    by_kind: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for frame, scene in enumerate(comparison.scenes):
        for kind, off in targets(comparison, frame):
            by_kind.setdefault(kind, {}).setdefault(scene, []).append(off)
    comparisons = []
    for kind, scenes in by_kind.items():
        if len(scenes) < RULES.fewest_for_scatter:
            continue
        count = sum(map(len, scenes.values()))
        off = [np.array(rows) for rows in scenes.values()]
        points = _errors([rows[:, 0] for rows in off])
        intensity = _errors([rows[:, 1] for rows in off])
        comparisons.append(Fidelity(kind, count, *points, *intensity))
    return tuple(sorted(comparisons, key=lambda fidelity: -fidelity.targets))


def targets(comparison: Comparison, frame: int) -> Iterator[tuple[str, tuple[float, float]]]:
    """The kind of each target of one frame with enough points on a side, and at least one measured; and how many more
    points it has in the simulation, and how much brighter it is, as shares of the measured."""
    scan, measured = comparison.scan, comparison.measured
    hit = np.asarray(scan.hit[frame])
    semantic, instance = np.asarray(scan.semantic[frame]), np.asarray(scan.instance[frame])
    range_m, intensity = np.asarray(scan.range_m[frame]), np.asarray(scan.intensity[frame])
    returned = np.asarray(measured.valid[frame])
    sensed_m, sensed = np.asarray(measured.range_m[frame]), np.asarray(measured.intensity[frame])
    rows, columns = hit.shape
    # Tiles are numbered row by row; the + 1 is for one that the border cuts.
    high, wide = RULES.target_tile
    tile = np.arange(rows)[:, None] // high * (columns // wide + 1) + np.arange(columns)[None, :] // wide
    for kind in np.unique(semantic[hit & (semantic > 0)]).tolist():
        of_kind = semantic == kind
        numbered = of_kind & (instance > 0)
        # Objects are numbered behind the tiles: one number tells either.
        number = np.where(numbered, instance.astype(np.int64) + tile.max() + 1, tile)
        for one in np.unique(number[of_kind]).tolist():
            mask = of_kind & (number == one)
            ours = mask & hit
            if not ours.any():
                continue
            low, high = range_m[ours].min() - RULES.target_beside_m, range_m[ours].max() + RULES.target_beside_m
            theirs = mask & returned & (sensed_m >= low) & (sensed_m <= high)
            points = int(ours.sum()), int(theirs.sum())
            # Errors are shares of the measured: where nothing was, there is none.
            if max(points) < RULES.fewest_target_points or not points[1]:
                continue
            name = NAMES.get(kind, f"class {kind}")
            name = name if numbered[mask].any() else f"{name}, patches"
            yield name, (_more(*points), _more(float(intensity[ours].mean()), float(sensed[theirs].mean())))


def _more(simulated: float, measured: float) -> float:
    """The difference as a share of the measured; NaN of nothing."""
    return simulated / measured - 1 if measured else float("nan")


def _errors(off: list[np.ndarray]) -> tuple[Interval, Interval]:
    """The mean absolute error and the mean signed one, of scenes' targets."""
    return mean_over_scenes([np.abs(rows) for rows in off], least=0.0), mean_over_scenes(off)


def mean_over_scenes(values: list[np.ndarray], *, least: float = -np.inf) -> Interval:
    """The mean over scenes of the means over their targets, in per cent; no absolute error is below 0 (`least`)."""
    means = np.array([known_mean(rows) for rows in values])
    return Interval.of_scenes(100 * means, "%", fewest=RULES.fewest_for_scatter, least=least)
