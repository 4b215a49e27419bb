"""The method where simulation and measurement show different streets: find, name, add, show, as far as it goes.

Rays cannot be compared one by one. What can be compared is the law of ln I given what both range images say of a ray
(range, incidence, row, azimuth, height and kind of surface, class where both know it), and the share of lost rays
given row and azimuth. Effects that act through these covariates can be told; others cannot, and the answer lists
them.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.devices import one_blas_thread
from jaxsim.discover.find.localise import Place
from jaxsim.discover.model.lattice import FINEST
from jaxsim.discover.name.unexplained import shape_of
from jaxsim.discover.scenes import Split, clipped, mean_interval, p_value, split
from jaxsim.discover.unpaired.choose import AGREE, DRAWS, LEVEL, Step, Tested, choose, tested
from jaxsim.discover.unpaired.conditional import Conditional, compare
from jaxsim.discover.unpaired.gap import show
from jaxsim.discover.unpaired.law import exchanged
from jaxsim.discover.unpaired.lost import Losses, losses
from jaxsim.discover.unpaired.refine import Refined, refine
from jaxsim.discover.unpaired.shared import INCIDENCE_SET, untold
from jaxsim.discover.unpaired.streets import PER_SCENE, Streets, read_streets
from jaxsim.discover.verdict import Interval, Named, Rank, Result, Unexplained, Verdict, Where
from jaxsim.effects import EFFECTS
from jaxsim.effects.chain import SensorModel

FEWEST = 8
"""Scenes that each side needs: 5 to find with, so that their exchange has 252 outcomes, and 3 to judge on."""
BETTER, SURELY = 1.3, 10.0
"""A free curve must gain BETTER times what the best effect does and SURELY nats more to say that it is none of them."""
CURVES = ("range", "incidence", "azimuth")
"""Free curves that are no effect of the catalogue; one along the row is beam_gain."""

Say = Callable[[str], None]


@one_blas_thread
def discover_unpaired(
    *, simulated: Path, measured: Path, per_scene: int = PER_SCENE, say: Say = lambda line: None
) -> Result:
    """Which effects of those that different streets can tell the simulation lacks.

    Both folders hold polar frames (docs/polar-frames.md) on one grid; names need not agree. `per_scene` rays of each
    scene are looked at. Raises ValueError where grids or units differ, frames are empty, or scenes are too few.
    """
    begun = time.monotonic()
    streets = read_streets(simulated, measured, per_scene=per_scene)
    parts, find = divide(streets)
    say(f"{len(parts.find)} scenes of both sides to find with, {len(parts.judge)} to judge on; the streets differ")
    draws = np.zeros((DRAWS, len(find)))
    draws[:, find] = exchanged(streets.measured[find], DRAWS)

    # Find: one law of both sides, and where the measured one leaves it.
    problem = compare(streets, find, draws)
    curves = tested(problem, draws, [], problem.curves)

    # Name: effects as columns of the measured side, judged by exchanging scenes.
    say(f"fitting {len({c.name for c in problem.candidates})} effects that act through what both sides have")
    steps, last = choose(problem, draws)
    answer, steps, unexplained = _not_in_catalogue(problem, steps, curves)
    lost = losses(streets, find)
    if answer == "none" and (lost.found or streets.steps):
        answer = "named"

    # Add: parameters of all of them together.
    say("fitting what was named together")
    refined = refine(problem, [step.chosen.candidate.columns for step in steps])
    named = (*_of_intensity(problem, steps, refined), *_of_loss(lost), *_of_readings(streets, find))
    sensor = _sensor(named)

    # Show: the scenes that nothing has seen.
    say("judging on unseen scenes")
    shown = show(problem, steps, refined)
    verdict = Verdict(
        verdict=answer,
        effects=named,
        where=_where(problem, curves),
        unexplained=unexplained,
        gap=shown.gap,
        closure=shown.closure,
        find=parts.find,
        judge=parts.judge,
        sha256=parts.sha256,
        frames=sum(streets.frames),
        seconds=time.monotonic() - begun,
        ranking=_ranking(steps, last),
        notes=_notes(streets, find, lost),
    )
    return Result(verdict, sensor, streets.grid, shown.maps_before, shown.maps_after, shown.curves)


def divide(streets: Streets) -> tuple[Split, np.ndarray]:
    """The division of both sides' scenes, and which are to find with. Raises ValueError for too few."""
    names = [[n for n, m in zip(streets.scenes, streets.measured, strict=True) if m == side] for side in (False, True)]
    for word, own in zip(("simulated", "measured"), names, strict=True):
        if len(own) < FEWEST:
            raise ValueError(
                f"discover: {len(own)} {word} scenes; where the streets differ each side needs {FEWEST} or more. "
                "Frames of one drive count as one scene: give more drives"
            )
    ours, theirs = (split(own) for own in names)
    together = hashlib.sha256((ours.sha256 + theirs.sha256).encode()).hexdigest()
    parts = Split((*ours.find, *theirs.find), (*ours.judge, *theirs.judge), together)
    return parts, np.array([name in parts.find for name in streets.scenes])


def _not_in_catalogue(
    problem: Conditional, steps: list[Step], curves: Sequence[Tested]
) -> tuple[str, list[Step], Unexplained | None]:
    good = [one for one in curves if one.accepted and one.candidate.name in CURVES]
    best = steps[0].chosen.total if steps else 0.0
    if good and good[0].total > BETTER * best + SURELY:
        return "not_in_catalogue", [], _described(problem, good[0])
    return ("named" if steps else "none"), steps, None


def _described(problem: Conditional, one: Tested) -> Unexplained:
    """The free curve on the find scenes, at its knots."""
    name, basis = one.candidate.name, one.candidate.columns.columns
    sensed = problem.streets.measured.astype(float)
    places = np.flatnonzero(problem.find)
    rng = np.random.default_rng(0)
    heights = []
    for draw in range(100):
        weight = problem.find.astype(float)
        if draw:
            weight = np.bincount(rng.choice(places, len(places)), minlength=len(sensed)).astype(float)
        inner, right, _, _ = problem.equations.pooled(weight, sensed)
        near, at = problem.nuisance, one.candidate.block
        columns = np.concatenate([near.columns, at.columns])
        held = np.concatenate([near.precision, at.precision])
        found = np.linalg.solve(inner[np.ix_(columns, columns)] + np.diag(held), right[columns])
        heights.append(found[len(near.columns) :])
    x = values_of(problem, name)
    knots = np.array([np.average(x, weights=basis[:, k] ** 4 + 1e-12) for k in range(basis.shape[1])])
    order = np.argsort(knots)
    y, band = heights[0][order], 1.645 * np.std(heights[1:], axis=0)[order]
    place = Place("intensity", name, one.p_value, 0.0, one.total)
    character, formula = shape_of(knots[order], y, basis.sum(0)[order], place)
    formula += " (x: ln of range in m)" if name == "range" else f" (x: {name})"
    return Unexplained("intensity", name, character, formula, tuple(knots[order]), tuple(y), tuple(band))


def values_of(problem: Conditional, covariate: str) -> np.ndarray:
    """A covariate of all rays, as verdicts compare it."""
    r = problem.rays
    of = {"range": np.log(r.range_m), "incidence": r.incidence_rad, "azimuth": r.azimuth_rad, "row": r.row}
    return np.asarray(of.get(covariate, problem.streets.semantic), float)


def _of_intensity(problem: Conditional, steps: Sequence[Step], refined: Refined) -> list[Named]:
    result = []
    for step, parameters in zip(steps, refined.intervals, strict=True):
        effect = EFFECTS[step.chosen.candidate.name]
        alike = [one.candidate.name for one in step.alike]
        if not problem.streets.shared_classes and effect.name in INCIDENCE_SET:
            alike += [name for name in INCIDENCE_SET if name != effect.name and name not in alike]
        apart = {n: effect.look_alikes.get(n) or EFFECTS[n].look_alikes.get(effect.name, "") for n in alike}
        result.append(
            Named(
                name=effect.name,
                look_alikes=tuple(alike),
                tell_apart={n: text or "frames of the same streets on both sides" for n, text in apart.items()},
                channels=effect.channels,
                p_value=step.chosen.p_value,
                gain=_gain(clipped(step.chosen.gain)),
                parameters=parameters,
            )
        )
    return result


def _gain(of_scenes: np.ndarray) -> Interval:
    return Interval(float(of_scenes.mean()), *mean_interval(of_scenes), "nats per scene")


def _of_loss(lost: Losses) -> list[Named]:
    return [
        Named(
            name=one.name,
            look_alikes=(),
            tell_apart={},
            channels=EFFECTS[one.name].channels,
            p_value=one.p_value,
            gain=one.share,
            parameters=dict(one.parameters),
        )
        for one in lost.found
    ]


def _of_readings(streets: Streets, find: np.ndarray) -> list[Named]:
    """Rounding, read off the values: each measured scene shows it."""
    result = []
    scenes = int((find & streets.measured).sum())
    rays = float((~streets.lost[streets.frames[0] :]).sum() / streets.measured.sum())
    for name, step in streets.steps.items():
        gain = rays * float(np.log(step / FINEST[name]))
        result.append(
            Named(
                name=name,
                look_alikes=(),
                tell_apart={},
                channels=EFFECTS[name].channels,
                p_value=2.0**-scenes,
                gain=Interval(gain, gain, gain, "nats per scene"),
                parameters={next(iter(EFFECTS[name].parameters)): Interval(step, step, step, "")},
            )
        )
    return result


def _sensor(named: Sequence[Named]) -> SensorModel:
    values: dict[str, dict[str, Any]] = {}
    for one in named:
        values[one.name] = {
            name: value.value if isinstance(value, Interval) else tuple(v.value for v in value)
            for name, value in one.parameters.items()
        }
    return SensorModel(tuple(values.items()))


def _where(problem: Conditional, curves: Sequence[Tested]) -> tuple[Where, ...]:
    whole = 2 * problem.equations.square[problem.find].sum()
    return tuple(
        Where("intensity", one.candidate.name, one.p_value, float(max(2 * one.total / whole, 0.0)))
        for one in curves
        if one.p_value <= AGREE and one.total > 0
    )


def _ranking(steps: Sequence[Step], last: Sequence[Tested]) -> tuple[Rank, ...]:
    """The first step's candidates and why each was not named."""
    rows = []
    best = steps[0] if steps else None
    for one in (best.ranking if best else last)[:12]:
        name, scenes = one.candidate.name, max(len(one.gain), 1)
        if best and name == best.chosen.candidate.name:
            why = ""
        elif best and name in {other.candidate.name for other in best.alike}:
            why = "these data cannot tell it from the one that is named"
        elif not one.accepted:
            why = f"scenes exchanged between the sides reach as much (p {one.p_value:.2g}, must be {LEVEL:g})"
            if one.p_value <= LEVEL:
                why = f"held-out scenes disagree on it (p {p_value(clipped(one.gain)):.2g}, must be {AGREE:g})"
        else:
            why = "it explains clearly less than the one that is named"
        rows.append(Rank(name, one.total / scenes, one.p_value, 0.0, why))
    return tuple(rows)


def _notes(streets: Streets, find: np.ndarray, lost: Losses) -> tuple[str, ...]:
    kinds = "classes, " if streets.shared_classes else ""
    notes = [
        "the two sides show different streets: what is compared is how readings depend on range, incidence, row, "
        f"azimuth, {kinds}height and kind of surface, not ray by ray; it is assumed that at equal values of these the "
        "streets hold the same mix of materials",
        *streets.notes,
        f"cannot be told unpaired: {', '.join(untold(streets.shared_classes))}",
    ]
    if not streets.shared_classes:
        notes.append("classes (semantic) in both folders would let effects of single classes be told too")
    if streets.noise_m > 0:
        notes.append(
            f"simulated ranges were given the noise of measured ones ({100 * streets.noise_m:.1f} cm) before angles "
            "were taken from them"
        )
    if find.sum() < 16:
        notes.append(f"{find.sum()} scenes to find with are few: weak effects cannot be told from none")
    return (*notes, *lost.notes)
