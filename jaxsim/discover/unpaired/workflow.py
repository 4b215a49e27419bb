"""The method where simulation and measurement show different streets: find, name, add, show, as far as it goes.

Rays cannot be compared one by one. What can be compared is the law of ln I given what both range images say of a ray
(range, incidence, row, azimuth, height and kind of surface, class where both know it), and the share of lost rays
given row and azimuth. Effects that act through these covariates can be told; others cannot, and the answer lists
them.
"""

from __future__ import annotations

import hashlib
import time
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from jaxsim.devices import one_blas_thread
from jaxsim.discover.name.select import Log
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import Split, split
from jaxsim.discover.unpaired.conditional import compare
from jaxsim.discover.unpaired.explain import (
    named_by_law,
    named_by_losses,
    named_by_values,
    notes,
    ranking,
    sensor_of,
    where,
)
from jaxsim.discover.unpaired.free_curves import outside_catalogue
from jaxsim.discover.unpaired.gap import show_gap
from jaxsim.discover.unpaired.law import exchanged
from jaxsim.discover.unpaired.lost import lost_rays
from jaxsim.discover.unpaired.read import PER_SCENE, UnpairedComparison, read_unpaired
from jaxsim.discover.unpaired.refine import refine
from jaxsim.discover.unpaired.select import Choice, choose, rank_terms
from jaxsim.discover.verdict import Result, Verdict


@one_blas_thread
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
    choice = choose(problem, draws)
    unexplained = outside_catalogue(problem, choice, curves)
    if unexplained:
        choice = Choice((), choice.last)
    lost = lost_rays(comparison, find)

    # Add: parameters of all of them together.
    log("fitting what was named together")
    refined = refine(problem, [step.chosen.term.columns for step in choice.steps])
    named = (
        *named_by_law(comparison, choice, refined),
        *named_by_losses(lost),
        *named_by_values(comparison, find),
    )
    answer = "not_in_catalogue" if unexplained else "named" if named else "none"

    # Show: the scenes that nothing has seen.
    log("judging on unseen scenes")
    shown = show_gap(problem, choice.steps, refined)
    verdict = Verdict(
        verdict=answer,
        effects=named,
        where=where(problem, curves),
        unexplained=unexplained,
        gap=shown.gap,
        closure=shown.closure,
        find=parts.find,
        judge=parts.judge,
        sha256=parts.sha256,
        frames=sum(comparison.frames),
        seconds=time.monotonic() - begun,
        ranking=ranking(choice),
        notes=notes(comparison, find, lost),
    )
    grid = comparison.grid
    return Result(verdict, sensor_of(named), grid, shown.maps_before, shown.maps_after, shown.curves)


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
        parts.append(split(names, fewest=RULES.unpaired_fewest_scenes))
    simulated, measured = parts
    together = hashlib.sha256((simulated.sha256 + measured.sha256).encode()).hexdigest()
    whole = Split((*simulated.find, *measured.find), (*simulated.judge, *measured.judge), together)
    return whole, np.array([name in whole.find for name in comparison.scenes])
