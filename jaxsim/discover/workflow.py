"""The whole method: find, name, add, show."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.columns import Blocks, blocks
from jaxsim.discover.evidence import Evidence, gather, with_planes
from jaxsim.discover.fit import CLUTTER, Problem, fit, on_top, to_values, to_z
from jaxsim.discover.interactions import interactions, spelled
from jaxsim.discover.intervals import intervals
from jaxsim.discover.lattice import FINEST
from jaxsim.discover.likelihood import CHANNELS
from jaxsim.discover.localise import COVARIATES, NAMED, Place, localise, p_value
from jaxsim.discover.name import ALIKE, BAR, Choice, Step, accepted, choose
from jaxsim.discover.nuisance import weights
from jaxsim.discover.null import first_residuals, fit_null, left_over
from jaxsim.discover.read import Comparison, read_comparison
from jaxsim.discover.residuals import residuals
from jaxsim.discover.result import Result
from jaxsim.discover.show import by_scene, curves_along, distances, floors, gaps, maps_of
from jaxsim.discover.split import Split, split
from jaxsim.discover.survey import Candidate, clipped
from jaxsim.discover.unexplained import agreed, describe, free_curves
from jaxsim.discover.verdict import Gap, Interval, Named, Rank, Unexplained, Verdict, Where
from jaxsim.effects import EFFECTS, Effect, get_effect
from jaxsim.effects.chain import SensorModel

BETTER = 1.1
"""A free curve must gain this many times what the named effects of its channel gain together to say that the effect is
not in the catalogue."""
SURELY = 10.0
"""... and so many nats more."""

CHANCE = 0.05
"""Dependences that chance explains more often than this are not reported."""

Say = Callable[[str], None]


NOTHING_YET = SensorModel()


def discover_folders(
    simulated: Path,
    measured: Path,
    *,
    effects: Iterable[str] = tuple(EFFECTS),
    known: SensorModel = NOTHING_YET,
    say: Say = lambda line: None,
) -> Result:
    """`discover` on two folders of polar frames (docs/polar-frames.md)."""
    return discover(read_comparison(simulated, measured), effects=effects, known=known, say=say)


def discover(
    comparison: Comparison,
    *,
    effects: Iterable[str] = tuple(EFFECTS),
    known: SensorModel = NOTHING_YET,
    say: Say = lambda line: None,
) -> Result:
    """Finds where simulation and measurement disagree, names the missing effect, adds it, and shows what is left.

    `effects` are the candidates, by default the whole catalogue. `known` is what the sensor model already has and the
    simulated frames do not show: it is put in place first, as it stands, and no candidate. So an answer can be fed
    back. Raises ValueError where the scenes are too few to decide anything, and for unknown effects.
    """
    there = [name for name, _ in known.effects]
    catalogue = [get_effect(name) for name in effects if name not in there]
    begun = time.monotonic()
    given = jax.tree.map(jnp.asarray, comparison.scan)
    scan = with_planes(given)
    measured = jax.tree.map(jnp.asarray, comparison.measured)
    chosen = blocks(comparison.scenes, *comparison.scan.range_m.shape[1:])
    parts = split(chosen.unit)

    # Find: the null model with its nuisances, and what its residuals still depend on.
    say(f"{len(parts.find)} scenes to find with, {len(parts.judge)} to judge on")
    ev, unit = _evidence(scan, given.incidence_rad, measured, chosen, parts.find, known)
    everyone = np.ones(len(unit), np.float32)
    null, _ = fit_null(scan, ev, everyone, clutter=bool({*there} & {*CLUTTER}))
    places = _places(null, everyone, unit)
    pairs = interactions(*_standardised(null, everyone), unit, level=CHANCE)

    # Name: the catalogue, one effect after another; then free curves for what is not in it.
    say(f"fitting {len(catalogue)} effects")
    choice = choose(null, catalogue, say=say)
    answer, choice, unexplained = _not_in_catalogue(null, choice, places, everyone, unit)

    # Add: every effect fitted again with the others in place.
    say("fitting what was named together")
    added = [step.chosen.effect for step in choice.steps]
    fitted = refit(null, added, [step.fitted.z for step in choice.steps], everyone)
    parameters = [intervals(effect, problem, found) for effect, problem, found in fitted]
    sensor = SensorModel((*known.effects, *((e.name, _plain(e, found.z)) for e, _, found in fitted)))

    # Show: the scenes that nothing has seen.
    say("judging on unseen scenes")
    both, both_unit = _evidence(scan, given.incidence_rad, measured, chosen, (*parts.find, *parts.judge), known)
    chain = [(e, found.z) for e, _, found in fitted]
    shown = _show(scan, both, both_unit, len(parts.find), null, choice.problem.noise, chain, _runner_up(choice))
    verdict = Verdict(
        verdict=answer,
        effects=tuple(_named(step, values) for step, values in zip(choice.steps, parameters, strict=True)),
        where=tuple(
            Where(p.channel, spelled(p.covariate, NAMED), p.p_value, p.share)
            for p in sorted([*places[:8], *pairs], key=lambda place: -place.gain)
            if p.p_value <= CHANCE
        ),
        unexplained=unexplained,
        gap=shown["gap"],
        closure=shown["closure"],
        find=parts.find,
        judge=parts.judge,
        sha256=parts.sha256,
        frames=len(comparison.names),
        seconds=time.monotonic() - begun,
        moved=_moved(null, choice.problem),
        ranking=_ranking(choice),
        notes=_notes(comparison, parts, there),
    )
    grid = comparison.scan.grid
    ranking = choice.steps[0].ranking if choice.steps else choice.last
    return Result(verdict, sensor, grid, shown["maps_before"], shown["maps_after"], shown["curves"], ranking)


def judge_known(
    comparison: Comparison, known: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, Gap], Interval | None]:
    """The gap on judge scenes that an answer known in advance reaches: `known` are the effects and the parameters that
    their fits begin at. What `discover` finds can be held against it; nothing is named, and there is no placebo.

    Raises ValueError for unknown effects and where the scenes are too few.
    """
    effects = [get_effect(name) for name in known]
    given = jax.tree.map(jnp.asarray, comparison.scan)
    scan = with_planes(given)
    measured = jax.tree.map(jnp.asarray, comparison.measured)
    chosen = blocks(comparison.scenes, *comparison.scan.range_m.shape[1:])
    parts = split(chosen.unit)
    ev, unit = _evidence(scan, given.incidence_rad, measured, chosen, parts.find)
    everyone = np.ones(len(unit), np.float32)
    null, _ = fit_null(scan, ev, everyone)
    starts = [to_z(effect, dict(known[effect.name]), ev.rays.row.shape[-1]) for effect in effects]
    fitted = refit(null, effects, starts, everyone)
    chain = [(effect, found.z) for effect, _, found in fitted]
    problem = null
    for effect, z in sorted(chain, key=lambda pair: list(EFFECTS).index(pair[0].name)):
        problem = on_top(effect, problem, z)
    problem, _ = fit_null(problem.scan, problem.ev, everyone, clutter=problem.clutter)
    both, both_unit = _evidence(scan, given.incidence_rad, measured, chosen, (*parts.find, *parts.judge))
    shown = _show(scan, both, both_unit, len(parts.find), null, problem.noise, chain, None)
    return shown["gap"], shown["closure"]


def _evidence(
    scan: Any, given_rad: Any, measured: Any, chosen: Blocks, names: Sequence[str], known: SensorModel = NOTHING_YET
) -> tuple[Evidence, np.ndarray]:
    """The evidence of the named units, and the place of each block's unit among `names`; `known` effects in place."""
    keep = np.array([unit in names for unit in chosen.unit])
    order = {name: k for k, name in enumerate(names)}
    unit = np.array([order[name] for name, kept in zip(chosen.unit, keep, strict=True) if kept])
    ev = gather(scan, measured, chosen.frame[keep], chosen.column[keep], unit, given_rad=given_rad)
    return (replace(ev, rays=known.apply(ev.rays, scan)) if known.effects else ev), unit


def _places(problem: Problem, everyone: Float[np.ndarray, " b"], unit: np.ndarray) -> list[Place]:
    return localise(*_standardised(problem, everyone), unit)


def _standardised(problem: Problem, everyone: Float[np.ndarray, " b"]) -> tuple[Any, dict[str, Any]]:
    """Rays on the host; each channel's standardised residuals and where they count."""
    host = jax.tree.map(np.asarray, problem.ev.rays)
    return host, {name: (z, counts) for name, (_, z, counts) in residuals(problem, everyone).items()}


def _not_in_catalogue(
    null: Problem, choice: Choice, places: list[Place], everyone: np.ndarray, unit: np.ndarray
) -> tuple[str, Choice, Unexplained | None]:
    """Whether free curves explain clearly more than what was chosen, and what they leave."""
    curves = [(place, curve) for place, curve in free_curves(null, places) if agreed(curve)]
    if curves:
        place, curve = curves[0]
        # In the curve's own channel: an effect may show in others besides.
        k = CHANNELS.index(place.channel)
        free, named = (
            curve.gain[:, k],
            sum((step.chosen.gain[:, k] for step in choice.steps), np.zeros(len(curve.gain))),
        )
        surplus = clipped(free - named)
        much = clipped(free).sum() > BETTER * max(clipped(named).sum(), 0.0) + SURELY
        if much and (not choice.steps or p_value(surplus) <= ALIKE):
            empty = Choice((), null, choice.steps[0].ranking if choice.steps else choice.last)
            return "not_in_catalogue", empty, describe(null, place, curve)
    if not choice.steps:
        return "none", choice, None
    left = [(p, c) for p, c in free_curves(choice.problem, _places(choice.problem, everyone, unit)) if agreed(c)]
    return "named", choice, describe(choice.problem, *left[0]) if left else None


def refit(
    null: Problem, effects: Sequence[Effect], z: Sequence[dict[str, Any]], everyone: np.ndarray, *, sweeps: int = 2
) -> list[tuple[Effect, Problem, Any]]:
    """Each effect fitted with all others in place; effects in physical order."""
    order = sorted(range(len(effects)), key=lambda k: list(EFFECTS).index(effects[k].name))
    values, result = dict(enumerate(z)), {}
    for _ in range(sweeps if len(effects) > 1 else 1):
        for k in range(len(effects)):
            problem = null
            for other in order:
                if other != k:
                    problem = on_top(effects[other], problem, values[other])
            problem, _ = fit_null(problem.scan, problem.ev, everyone, clutter=problem.clutter)
            # Values that are read off the data (steps of rounding) stay.
            start = ({n: np.asarray(v) for n, v in to_values(effects[k], values[k]).items()},)
            found = fit(effects[k], problem, everyone, starts=start, steps=80, fixed=effects[k].name in FINEST)
            values[k] = found.z
            result[k] = (effects[k], problem, found)
    return [result[k] for k in range(len(effects))]


def _show(
    scan: Any,
    ev: Evidence,
    unit: np.ndarray,
    find: int,
    null: Problem,
    noise: Any,
    chain: list[tuple[Effect, Any]],
    rival: Candidate | None,
) -> dict[str, Any]:
    """Everything that is shown of judge scenes with the effects of `chain` in place, which leave `noise`; `rival` is
    the placebo. Shared nuisances come from the find scenes."""
    fitted = (unit < find).astype(np.float32)
    judged = unit >= find

    def problem_of(effects: Sequence[tuple[Effect, Any]], noise: Any) -> Problem:
        problem = Problem(scan, ev, null.weights, noise, null.clutter)
        for effect, z in sorted(effects, key=lambda pair: list(EFFECTS).index(pair[0].name)):
            problem = on_top(effect, problem, z, simulated=True)
        raw = weights(problem.ev, noise, *first_residuals(problem.ev))
        off = left_over(problem.ev, raw, jnp.asarray(fitted))
        return replace(problem, weights=weights(problem.ev, noise, *off))

    def distance(problem: Problem) -> np.ndarray:
        found = distances(problem.ev.rays, problem.ev, problem.noise, problem.weights, jnp.asarray(fitted))
        return by_scene(np.asarray(found)[judged], unit[judged])

    before, after = problem_of([], null.noise), problem_of(chain, noise)
    placebo = problem_of([(rival.effect, rival.fits[0].z)], null.noise) if rival else before
    channels = {name for effect, _ in chain for name in effect.channels}
    covariates = {name for effect, _ in chain for name in effect.covariates} or set(COVARIATES)
    floor = floors(before, fitted, judged, unit, distance(before), sorted(covariates))
    gap, closure = gaps(distance(before), distance(after), distance(placebo), floor, sorted(channels))
    return {
        "gap": gap,
        "closure": closure,
        "maps_before": maps_of(before, fitted, judged),
        "maps_after": maps_of(after, fitted, judged),
        "curves": curves_along(before, after, fitted, judged, unit, [effect for effect, _ in chain]),
    }


def _runner_up(choice: Choice) -> Candidate | None:
    """The best candidate of the first step that is neither named nor a look-alike."""
    if not choice.steps:
        return None
    first = choice.steps[0]
    taken = {first.chosen.effect.name, *(c.effect.name for c in first.alike)}
    rest = [c for c in first.ranking if c.effect.name not in taken]
    return rest[0] if rest else None


def _plain(effect: Effect, z: dict[str, Any]) -> dict[str, Any]:
    values = {}
    for name, p in effect.parameters.items():
        value = np.clip(np.asarray(to_values(effect, z)[name], float), p.low, p.high)
        values[name] = float(value) if value.ndim == 0 else tuple(value.tolist())
    return values


def _named(step: Step, parameters: dict[str, Any]) -> Named:
    effect, gain = step.chosen.effect, clipped(step.chosen.by_unit)
    draws = np.random.default_rng(0).choice(gain, (2000, len(gain))).mean(1)
    low, high = np.quantile(draws, [0.05, 0.95])
    alike = tuple(c.effect.name for c in step.alike)
    apart = {name: effect.look_alikes.get(name) or EFFECTS[name].look_alikes.get(effect.name, "") for name in alike}
    return Named(
        name=effect.name,
        look_alikes=alike,
        tell_apart={name: text or "scenes in which their covariates differ more" for name, text in apart.items()},
        channels=effect.channels,
        p_value=step.p_value,
        gain=Interval(float(gain.mean()), float(low), float(high), "nats per scene"),
        parameters=parameters,
    )


def _ranking(choice: Choice) -> tuple[Rank, ...]:
    """The first step's candidates and why each was not named."""
    ranking = choice.steps[0].ranking if choice.steps else choice.last
    best = choice.steps[0] if choice.steps else None
    rows = []
    for candidate in ranking[:12]:
        name, p = candidate.effect.name, candidate.chance
        if best and name == best.chosen.effect.name:
            why = ""
        elif best and name in {c.effect.name for c in best.alike}:
            why = "these data cannot tell it from the one that is named"
        elif not accepted(candidate):
            why = "its gain is within what a null reaches, or the scenes disagree on it"
        else:
            why = "it explains clearly less than the one that is named"
        rows.append(
            Rank(name, candidate.total / max(len(candidate.by_unit), 1), p, BAR / max(len(candidate.by_unit), 1), why)
        )
    return tuple(rows)


def _moved(null: Problem, after: Problem) -> dict[str, tuple[float, float]]:
    names = null.noise.__dataclass_fields__
    return {n: (float(getattr(null.noise, n)), float(getattr(after.noise, n))) for n in names}


def _notes(comparison: Comparison, parts: Split, there: Sequence[str]) -> tuple[str, ...]:
    notes = list(comparison.notes)
    if there:
        notes.append(f"beside what the sensor model already had: {', '.join(there)}")
    if len(set(comparison.scenes)) == 1:
        notes.append(
            "one drive alone: its frames are cut into the same sectors with gaps between them; sectors are less "
            "independent than drives"
        )
    if len(parts.find) < 8:
        notes.append(f"{len(parts.find)} scenes to find with are few: weak effects cannot be told from none")
    return tuple(notes)
