"""The gap on judge scenes where the streets differ: how far measured readings lie from the law of both sides, before
and after the effects were added. Letters as in law.py.

Levels of surfaces and of a scene, and its slopes, are taken out (nobody knows them of a street that was not
simulated); what the law, the nuisances and the effects say comes from the find scenes alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.curves_and_maps import Bins, mean_on_grid
from jaxsim.discover.gap import gap_of, share_of
from jaxsim.discover.name.select import Step, runner_up
from jaxsim.discover.unpaired.conditional import Conditional
from jaxsim.discover.unpaired.law import Block, Equations, Solution, solve
from jaxsim.discover.unpaired.refine import Refined, equations_without
from jaxsim.discover.unpaired.select import UnpairedCandidate
from jaxsim.discover.verdict import CurveLine, Judged

UNIT = "root mean square error of ln I, levels of surfaces taken out"
CURVE_UNIT = "ln I, measured minus the law of both sides"


def show_gap(problem: Conditional, steps: Sequence[Step[UnpairedCandidate]], refined: Refined) -> Judged:
    """Distances, maps and curves of the measured judge scenes."""
    near = problem.side[:, problem.nuisance.columns]
    plain = equations_without(problem, near, np.zeros(len(problem.y)))
    added = equations_without(problem, near, refined.change) if steps else plain
    comparison = problem.comparison
    judged = np.flatnonzero(comparison.measured & ~problem.find)
    rays = np.bincount(comparison.scene, minlength=len(comparison.measured))[judged]

    def distance(eq: Equations, blocks: Sequence[Block] = ()) -> Float[np.ndarray, " j"]:
        """The root mean square error of each judge scene."""
        solution = _solution(problem, eq, [problem.nuisance, *blocks])
        loss = eq.losses(solution, problem.measured)[judged]
        # Back from nats: the loss is half the squares over variance and inflation, of all rays of a scene.
        return np.sqrt(np.maximum(2 * loss * problem.inflation * problem.variance / rays, 0))

    before = distance(plain)
    after = distance(added)
    floor = distance(problem.equations, [curve.block for curve in problem.curves])
    rival = runner_up(steps)
    placebo = distance(problem.equations, [rival.term.block]) if rival else before
    gap = gap_of(before, after, placebo=placebo, floor=floor, unit=UNIT)
    closure = share_of(before - after, before - floor, unit="share of what can be explained") if steps else None

    # Residuals of rays, for the report.
    old = _residual(problem, plain, 0.0)
    new = _residual(problem, added, refined.change)
    keep = np.isin(comparison.scene, judged)
    shape = (comparison.rows, len(np.asarray(comparison.grid.azimuth_rad)))
    row = problem.rays.row[keep]
    column = problem.rays.column[keep]
    maps = [{"intensity": mean_on_grid(off[keep], row, column, shape=shape)} for off in (old, new)]
    return Judged({"intensity": gap}, closure, maps[0], maps[1], _curves(problem, steps, old, after=new, keep=keep))


def _solution(problem: Conditional, eq: Equations, blocks: Sequence[Block]) -> Solution:
    """Blocks fitted to the find scenes."""
    return solve(eq.pooled(problem.weight, problem.measured), blocks)


def _residual(problem: Conditional, eq: Equations, change: Float[np.ndarray, " n"] | float) -> Float[np.ndarray, " n"]:
    """Measured minus law and nuisances (and the change by effects), less the mean of each scene."""
    solution = _solution(problem, eq, [problem.nuisance])
    expected = problem.law @ solution.law + problem.side[:, problem.nuisance.columns] @ solution.side
    off = problem.y - expected - change
    scene = problem.comparison.scene
    # Levels of streets are no error: materials differ from street to street.
    return off - (np.bincount(scene, off) / np.bincount(scene))[scene]


def _curves(
    problem: Conditional,
    steps: Sequence[Step[UnpairedCandidate]],
    before: Float[np.ndarray, " n"],
    *,
    after: Float[np.ndarray, " n"],
    keep: Bool[np.ndarray, " n"],
) -> tuple[CurveLine, ...]:
    """Mean residual of the rays to `keep` along the named effects' own covariates."""
    known = problem.comparison.covariates
    names = {name: None for step in steps for name in step.chosen.effect.covariates if name in known}
    lines = []
    for name in names:
        bins = Bins.of(known[name][keep], name, problem.comparison.scene[keep])
        if bins is not None:
            lines.append(CurveLine("intensity", name, CURVE_UNIT, bins.centre, *bins.curve(before[keep], after[keep])))
    return tuple(lines)
