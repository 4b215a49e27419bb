"""The method where simulation and measurement show different streets: find, name, add, show, as far as it goes.

Rays cannot be compared one by one. What can be compared is the law of ln I given what both range images say of a ray
(range, incidence, row, azimuth, height and kind of surface, class where both know it), and the share of lost rays
given row and azimuth. Effects that act through these covariates can be told; others cannot, and the answer lists
them.

The gap on judge scenes is how far measured readings lie from the law of both sides, before and after the effects were
added. Levels of surfaces and of a scene, and its slopes, are taken out (nobody knows them of a street that was not
simulated); what the law, the nuisances and the effects say comes from the find scenes alone. Letters as in
equations.py.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.devices import by_small_steps
from jaxsim.discover.name.select import Step, runner_up
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import Split, split_scenes
from jaxsim.discover.show.explain import CANNOT_TELL, named, ranking
from jaxsim.discover.show.gap import gap_of, share_of
from jaxsim.discover.show.pictures import Bins, GridSums
from jaxsim.discover.unpaired.columns import INCIDENCE_SET, untold
from jaxsim.discover.unpaired.conditional import Conditional, compare
from jaxsim.discover.unpaired.equations import Block, Equations, exchanged, without_random
from jaxsim.discover.unpaired.held_out import held_out_losses
from jaxsim.discover.unpaired.lost import lattices, lost_rays
from jaxsim.discover.unpaired.read import PER_SCENE, UnpairedComparison, read_unpaired
from jaxsim.discover.unpaired.refine import Refined, equations_without, gain_of, refine
from jaxsim.discover.unpaired.select import (
    UnpairedCandidate,
    UnpairedChoice,
    choose_unpaired,
    outside_catalogue,
    rank_terms,
)
from jaxsim.discover.verdict import CurveLine, Interval, Judged, Named, Result, Verdict, Where
from jaxsim.effects.chain import SensorModel
from jaxsim.progress import Log

UNIT = "root mean square error of ln I, levels of surfaces taken out"
CURVE_UNIT = "ln I, measured minus the law of both sides, levels of surfaces taken out"


@by_small_steps
def discover_unpaired(
    *, simulated: Path, measured: Path, per_scene: int = PER_SCENE, log: Log = lambda line: None
) -> Result:
    """Which effects of those that different streets can tell the simulation lacks.

    Both folders hold polar frames (docs/polar-frames.md) on one grid; names need not agree. `per_scene` rays of each
    scene are looked at; `log` is given lines on the progress. Raises ValueError where grids or units differ, frames are
    empty, or scenes are too few.
    """
    begun = time.monotonic()
    comparison = read_unpaired(simulated, measured, per_scene=per_scene)
    parts, find = divide(comparison)
    log(f"{len(parts.find)} scenes of both sides to find with, {len(parts.judge)} to judge on; the streets differ")
    draws = np.zeros((RULES.unpaired_exchanges, len(find)))
    draws[:, find] = exchanged(comparison.measured[find], RULES.unpaired_exchanges)

    # Find: one law of both sides, and where the measured one leaves it.
    problem = compare(comparison, find, draws)
    curves = rank_terms(problem, problem.curves, draws)

    # Name: effects as columns of the measured side, judged by exchanging scenes.
    log(f"fitting {len({term.name for term in problem.terms})} effects that act through what both sides have")
    choice = choose_unpaired(problem, draws)
    # The strongest effect where it is fitted, not where its column was taken.
    strongest = [step.chosen.term.columns for step in choice.steps[:1]]
    strongest_nats = gain_of(problem, refine(problem, strongest)) if strongest else 0.0
    unexplained = outside_catalogue(problem, choice, curves, strongest_nats=strongest_nats)
    if unexplained:
        # What a free curve outdoes is not named: the catalogue's nearest law would be a wrong answer.
        choice = UnpairedChoice((), choice.last)
    lost, of_losses = lost_rays(comparison, find)

    # Add: parameters of all of them together.
    log("fitting what was named together")
    refined = refine(problem, [step.chosen.term.columns for step in choice.steps])
    by_law = [named_by_law(comparison, *one) for one in zip(choice.steps, refined.intervals, strict=True)]
    effects = (*by_law, *lost, *lattices(comparison, find))
    answer = "not_in_catalogue" if unexplained else "named" if effects else "none"

    # Show: the scenes that nothing has seen.
    log("judging on unseen scenes")
    shown = unpaired_gap(problem, choice.steps, refined)
    verdict = Verdict(
        verdict=answer,
        effects=effects,
        where=curve_covariates(problem, curves),
        unexplained=unexplained,
        gap=shown.gap,
        closure=shown.closure,
        find=parts.find,
        judge=parts.judge,
        sha256=parts.sha256,
        frames=sum(comparison.frames),
        seconds=time.monotonic() - begun,
        ranking=ranking(choice, why_not_unpaired),
        notes=(*unpaired_notes(comparison, find), *of_losses),
    )
    grid = comparison.grid
    effects_model = SensorModel(tuple((effect.name, effect.values) for effect in effects))
    return Result(verdict, effects_model, grid, shown.maps_before, shown.maps_after, shown.curves)


def unpaired_gap(problem: Conditional, steps: Sequence[Step[UnpairedCandidate]], refined: Refined) -> Judged:
    """Distances, maps and curves of the measured judge scenes."""
    near = problem.side[:, problem.nuisance.columns]
    plain = equations_without(problem, near, np.zeros(len(problem.y)))
    added = equations_without(problem, near, refined.change) if steps else plain
    comparison = problem.comparison
    judged = np.flatnonzero(comparison.measured & ~problem.find)
    rays = np.bincount(comparison.scene, minlength=len(comparison.measured))[judged]

    def distance(eq: Equations, blocks: Sequence[Block] = ()) -> Float[np.ndarray, " j"]:
        """The root mean square error of each judge scene."""
        loss = eq.losses(problem.solved(blocks, eq), problem.measured)[judged]
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
    cells = problem.rays.row[keep], problem.rays.column[keep]
    maps = [{"intensity": GridSums.of(off[keep], cells, comparison.grid).mean()} for off in (old, new)]
    return Judged({"intensity": gap}, closure, maps[0], maps[1], _curves(problem, steps, old, after=new, keep=keep))


def _residual(problem: Conditional, eq: Equations, change: Float[np.ndarray, " n"] | float) -> Float[np.ndarray, " n"]:
    """Measured minus law and nuisances (and the change by effects), less what is each scene's own: what the gap is the
    mean square of."""
    solution = problem.solved([], eq)
    expected = problem.law @ solution.law + problem.side[:, problem.nuisance.columns] @ solution.side
    off = problem.y - expected - change
    # Levels of streets are no error: materials differ from street to street.
    return without_random(off, problem.random, scene=problem.comparison.scene, variance=problem.variance)


def _curves(
    problem: Conditional,
    steps: Sequence[Step[UnpairedCandidate]],
    before: Float[np.ndarray, " n"],
    *,
    after: Float[np.ndarray, " n"],
    keep: Bool[np.ndarray, " n"],
) -> tuple[CurveLine, ...]:
    """Mean residual of the rays to `keep` along the named effects' own covariates."""
    covariates = problem.comparison.covariates
    names = {name: None for step in steps for name in step.chosen.effect.covariates if name in covariates}
    lines = []
    for name in names:
        bins = Bins.of(covariates[name][keep], name, problem.comparison.scene[keep])
        if bins is not None:
            lines.append(CurveLine("intensity", name, CURVE_UNIT, bins.centre, *bins.curve(before[keep], after[keep])))
    return tuple(lines)


def divide(comparison: UnpairedComparison) -> tuple[Split, Bool[np.ndarray, " s"]]:
    """The division of both sides' scenes, and which are to find with. Raises ValueError for too few."""
    parts = []
    for word, side in (("simulated", ~comparison.measured), ("measured", comparison.measured)):
        names = [name for name, is_side in zip(comparison.scenes, side, strict=True) if is_side]
        if len(names) < RULES.unpaired_fewest_scenes:
            raise ValueError(
                f"discover: {len(names)} {word} scenes; where the streets differ each side needs "
                f"{RULES.unpaired_fewest_scenes} or more. Frames of one drive count as one scene: give more drives"
            )
        parts.append(split_scenes(names, fewest=RULES.unpaired_fewest_scenes))
    simulated, measured = parts
    together = hashlib.sha256((simulated.sha256 + measured.sha256).encode()).hexdigest()
    whole = Split((*simulated.find, *measured.find), (*simulated.judge, *measured.judge), together)
    return whole, np.array([name in whole.find for name in comparison.scenes])


def named_by_law(
    comparison: UnpairedComparison,
    step: Step[UnpairedCandidate],
    parameters: dict[str, Interval | tuple[Interval, ...]],
) -> Named:
    """An effect on the law of ln I."""
    name = step.chosen.name
    contrast = name in INCIDENCE_SET and not comparison.shared_classes
    alike = [other for other in INCIDENCE_SET if other != name] if contrast else []
    return named(step, parameters, more_alike=alike, remedy="frames of the same streets on both sides")


def curve_covariates(problem: Conditional, curves: Sequence[UnpairedCandidate]) -> tuple[Where, ...]:
    """The covariates along which free curves gain, each with its share of the squares of held-out residuals."""
    # Both are halves of squares, of which a share is that of the squares themselves.
    before = held_out_losses(problem, problem.nuisance).sum()
    return tuple(
        Where("intensity", curve.name, curve.chance, float(max(curve.by_scene.sum() / before, 0.0)))
        for curve in curves
        if curve.chance <= RULES.unpaired_agreement_level and curve.total > 0
    )


def why_not_unpaired(candidate: UnpairedCandidate, choice: UnpairedChoice) -> str:
    """Why a candidate of the first step is not what was named first; empty if it is."""
    first = choice.steps[0] if choice.steps else None
    if first and candidate.name == first.chosen.name:
        return ""
    if first and candidate.name in {look_alike.name for look_alike in first.alike}:
        return CANNOT_TELL
    if candidate.of_ground:
        return "the ground alone shows it, which may be of another material on the two sides"
    if candidate.accepted:
        return "it explains clearly less than the one that is named"
    if candidate.chance <= RULES.unpaired_level:
        level = RULES.unpaired_agreement_level
        return f"held-out scenes disagree on it (p {candidate.agreement:.2g}, must be {level:g})"
    return (
        f"scenes exchanged between the sides reach as much (p {candidate.chance:.2g}, must be {RULES.unpaired_level:g})"
    )


def unpaired_notes(comparison: UnpairedComparison, find: Bool[np.ndarray, " s"]) -> tuple[str, ...]:
    """What a reader must know."""
    classes = "classes, " if comparison.shared_classes else ""
    lines = [
        "the two sides show different streets: what is compared is how readings depend on range, incidence, row, "
        f"azimuth, {classes}height and kind of surface, not ray by ray; it is assumed that at equal values of these "
        "the streets hold the same mix of materials",
        *comparison.notes,
        f"cannot be told unpaired: {', '.join(untold(classes=comparison.shared_classes))}",
    ]
    if not comparison.shared_classes:
        lines.append("classes (semantic) in both folders would let effects of single classes be told too")
    if comparison.noise_m > 0:
        lines.append(
            f"simulated ranges were given the noise of measured ones ({100 * comparison.noise_m:.1f} cm) before "
            "angles were taken from them"
        )
    if find.sum() < RULES.unpaired_few_scenes:
        lines.append(f"{find.sum()} scenes to find with are few: weak effects cannot be told from none")
    return tuple(lines)
