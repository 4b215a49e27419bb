"""The gap on judge scenes where the streets differ: how far measured readings lie from the law of both sides, before
and after the effects were added.

Levels of surfaces and of a scene, and its slopes, are taken out (nobody knows them of a street that was not
simulated); what the law, the nuisances and the effects say comes from the find scenes alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.localise import CATEGORICAL
from jaxsim.discover.scenes import half_width, mean_interval, ratio_interval
from jaxsim.discover.unpaired.choose import Step
from jaxsim.discover.unpaired.conditional import Conditional
from jaxsim.discover.unpaired.law import Block, Equations, solve
from jaxsim.discover.unpaired.refine import Refined, equations_of
from jaxsim.discover.verdict import CurveLine, Gap, Interval, Judged
from jaxsim.effects import EFFECTS

UNIT = "root mean square error of ln I, levels of surfaces taken out"
MAP_COLUMNS = 32
BINS = 16


def show(problem: Conditional, steps: Sequence[Step], refined: Refined) -> Judged:
    """Distances, maps and curves of the measured judge scenes."""
    near = problem.side[:, problem.nuisance.columns]
    plain = equations_of(problem, near, np.zeros(len(problem.y)))
    added = equations_of(problem, near, refined.change) if steps else plain
    sensed = problem.streets.measured
    judged = np.flatnonzero(sensed & ~problem.find)
    rays = np.bincount(problem.streets.scene, minlength=len(sensed))[judged]

    def distance(eq: Equations, blocks: Sequence[Block] = ()) -> np.ndarray:
        loss = _losses(problem, eq, [problem.nuisance, *blocks])[judged]
        return np.sqrt(np.maximum(2 * loss * problem.inflation * problem.variance / rays, 0))

    before, after = distance(plain), distance(added)
    floor = distance(problem.equations, [curve.block for curve in problem.curves])
    rival = _runner_up(steps)
    placebo = distance(problem.equations, [rival]) if rival else before
    found, closure = _gap(before, after, floor, placebo, bool(steps))
    off = [_residual(problem, eq, change) for eq, change in ((plain, 0.0), (added, refined.change))]
    keep = np.isin(problem.streets.scene, judged)
    maps = [{"intensity": _map(problem, one, keep)} for one in off]
    return Judged({"intensity": found}, closure, maps[0], maps[1], _curves(problem, steps, off[0], off[1], keep))


def _losses(problem: Conditional, eq: Equations, blocks: Sequence[Block]) -> Float[np.ndarray, " s"]:
    sensed = problem.streets.measured.astype(float)
    inner, right, cross, base = eq.pooled(problem.find.astype(float), sensed)
    side, columns, _ = solve(inner, right, blocks)
    return eq.losses(base - cross[:, columns] @ side, side, columns, sensed)


def _residual(problem: Conditional, eq: Equations, change: np.ndarray | float) -> Float[np.ndarray, " n"]:
    """Measured minus law and nuisances (and the change by effects), less the mean of each scene."""
    sensed = problem.streets.measured.astype(float)
    inner, right, cross, base = eq.pooled(problem.find.astype(float), sensed)
    side, columns, _ = solve(inner, right, [problem.nuisance])
    said = problem.law @ (base - cross[:, columns] @ side) + problem.side[:, problem.nuisance.columns] @ side
    off, scene = problem.y - said - change, problem.streets.scene
    return off - (np.bincount(scene, off) / np.bincount(scene))[scene]


def _runner_up(steps: Sequence[Step]) -> Block | None:
    if not steps:
        return None
    taken = {one.candidate.name for step in steps for one in (step.chosen, *step.alike)}
    rest = [one for one in steps[0].ranking if one.candidate.name not in taken]
    return rest[0].candidate.block if rest else None


def _gap(
    before: np.ndarray, after: np.ndarray, floor: np.ndarray, placebo: np.ndarray, named: bool
) -> tuple[Gap, Interval | None]:
    shrunk, room = before - after, before - floor
    values = [float(x.mean()) for x in (before, after, floor, placebo)]
    gap = Gap(values[0], values[1], *mean_interval(shrunk), UNIT, values[2], values[3], float((shrunk > 0).mean()))
    if not named or not mean_interval(room)[0] > 0:
        return gap, None
    ends = ratio_interval(shrunk, room)
    return gap, Interval(float(shrunk.mean() / room.mean()), *ends, "share of what can be explained")


def _map(problem: Conditional, off: np.ndarray, keep: np.ndarray) -> Float[np.ndarray, "r c"]:
    """Mean of each row and group of columns, spread over the grid; NaN where nothing was compared."""
    r = problem.rays
    rows, columns = (len(np.asarray(x)) for x in (problem.streets.grid.elevation_rad, problem.streets.grid.azimuth_rad))
    bins = min(columns, MAP_COLUMNS)
    place = (r.row * bins + r.column * bins // columns)[keep]
    count = np.bincount(place, minlength=rows * bins)
    mean = np.where(count > 0, np.bincount(place, off[keep], rows * bins) / np.maximum(count, 1), np.nan)
    return mean.reshape(rows, bins)[:, np.arange(columns) * bins // columns]


def _curves(
    problem: Conditional, steps: Sequence[Step], before: np.ndarray, after: np.ndarray, keep: np.ndarray
) -> tuple[CurveLine, ...]:
    r, scene, lines = problem.rays, problem.streets.scene[keep], []
    of = {"range": np.log(r.range_m), "incidence": r.incidence_rad, "azimuth": r.azimuth_rad, "row": r.row}
    covariates = {c: None for step in steps for c in EFFECTS[step.chosen.candidate.name].covariates if c in of}
    for name in covariates:
        x = np.asarray(of[name], float)[keep]
        edges = [*np.unique(x), np.inf] if name in CATEGORICAL else np.unique(np.quantile(x, np.linspace(0, 1, BINS)))
        size = len(edges) - 1
        place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, size - 1)
        count = np.maximum(np.bincount(place, minlength=size), 1)
        means = [np.bincount(place, off[keep], size) / count for off in (before, after)]
        scenes = []
        for s in np.unique(scene):
            own = scene == s
            k = np.bincount(place[own], minlength=size)
            total = np.bincount(place[own], before[keep][own], size)
            scenes.append(np.where(k > 0, total / np.maximum(k, 1), means[0]))
        band = half_width(np.array(scenes))
        centre = np.bincount(place, x, size) / count
        lines.append(
            CurveLine("intensity", name, "ln I, measured minus the law of both sides", centre, means[0], means[1], band)
        )
    return tuple(lines)
