"""Conclude: an answer held against the scenes that nothing has seen, as a verdict, and as a sensor model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from jaxsim.devices import side_by_side
from jaxsim.discover.find.levels import compare_levels, made_by, missing
from jaxsim.discover.find.targets import compare_objects
from jaxsim.discover.law.search import closed_law
from jaxsim.discover.model.fit import in_place
from jaxsim.discover.model.null_model import residuals
from jaxsim.discover.mounting.change import named_knock
from jaxsim.discover.mounting.constant import how_placed, named_mounting, registered_of
from jaxsim.discover.name.simulator_contrast import contrast_of_answer
from jaxsim.discover.read.control import NO_CONTROL
from jaxsim.discover.regimes.find import Divided
from jaxsim.discover.repeats.examine import formula_of
from jaxsim.discover.show import effects_model_of, judged_by_reported, show_gap, with_placed, without_unconfirmed
from jaxsim.discover.show.every_frame import HeldAnswer, JudgedRest, judge_rest, rest_in_words
from jaxsim.discover.show.explain import (
    all_named,
    coarse_shapes,
    notes,
    nuisance_changes,
    own_candidates,
    ranking,
    usual_last,
    why_not,
)
from jaxsim.discover.show.sensitivity import sensitivities
from jaxsim.discover.stages.ask import Asked
from jaxsim.discover.stages.complete import Completed
from jaxsim.discover.verdict import Fidelity, InPlace, Judged, Level, Result, Sensitivity, Verdict
from jaxsim.effects.chain import SensorModel
from jaxsim.progress import Log


@dataclass(frozen=True)
class Shown:
    """What unseen scenes show of an answer, and what both sides are beside it."""

    judged: Judged
    levels: tuple[Level, ...]
    objects: tuple[Fidelity, ...]
    sensitivity: tuple[Sensitivity, ...]
    rest: JudgedRest
    maps: tuple[dict[str, Float[np.ndarray, "r c"]], dict[str, Float[np.ndarray, "r c"]]]
    """Residuals before and after, of all frames where these were judged."""
    apart: dict[str, float]
    """`judged_by_reported`."""


def show(asked: Asked, completed: Completed, *, every_frame: bool, log: Log) -> Shown:
    """Holds an answer against judge scenes, and with `every_frame` against all frames that were not read."""
    log("judging on unseen scenes")
    found, comparison = asked.placed.found, asked.placed.comparison
    choice, added = completed.answer.choice, completed.added
    judged, (levels, objects, sensitive) = side_by_side(
        partial(show_gap, found.null_model, choice, added),
        lambda: (
            compare_levels(comparison),
            compare_objects(comparison),
            sensitivities(found.null_model.problem, asked.catalogue),
        ),
    )
    maps = judged.maps_before, judged.maps_after
    rest = JudgedRest()
    if every_frame and comparison.rest:
        log(f"judging the other {len(comparison.rest.names)} frames")
        held = HeldAnswer(found.null_model, added.chain, choice.problem.noise, asked.placed.knock)
        rest = judge_rest(comparison, asked.placed.mounting, held)
    apart = judged_by_reported(found.null_model, added)
    return Shown(judged, levels, objects, sensitive, rest, rest.maps or maps, apart)


def verdict_of(
    asked: Asked, divided: Divided, completed: Completed, *, shown: Shown, given: SensorModel, seconds: float
) -> Verdict:
    """The answer in plain values, beside what was `given` of the sensor: what fits and judge scenes say, before what
    was put in place first is told with it."""
    placed, every = asked.placed, shown.rest.every
    answer, added = completed.answer, completed.added
    choice, null = answer.choice, placed.found.null_model.problem
    control, learned_before = placed.division.control, len(placed.mounting.known.learned)
    return Verdict(
        verdict=answer.verdict,
        effects=usual_last(all_named(null, choice.steps, added)),
        frames=len(placed.comparison.names),
        where=placed.found.where,
        unexplained=answer.unexplained,
        gap=shown.judged.gap,
        closure=shown.judged.closure,
        find=placed.division.parts.find,
        judge=placed.division.parts.judge,
        sha256=placed.division.parts.sha256,
        moved=nuisance_changes(null, choice, [refit.fit.z for refit in added.refits]),
        ranking=ranking(choice, why_not, bar=choice.bars.effect),
        nulls=answer.nulls,
        levels=shown.levels,
        contrast=contrast_of_answer(asked.contrast, choice.problem) if asked.contrast else None,
        control=InPlace(control.model.names, control.contrast_off) if control is not NO_CONTROL else None,
        objects=shown.objects,
        own=own_candidates(choice),
        learned=added.effects_model.learned[learned_before:],
        law=closed_law(added.learned) if added.learned else formula_of(completed.repeats),
        repeats=tuple(repeat.repeat for repeat in completed.repeats),
        every_frame=every,
        regimes=divided.regimes,
        registered=registered_of(placed.comparison),
        unrelated=asked.unrelated is not None,
        sensitivity=shown.sensitivity,
        notes=(
            *notes(placed.comparison, placed.division, answer, held=given.names),
            *coarse_shapes(residuals(choice.problem, choice.problem.ev.all_blocks)["range"], shown.levels),
            *([rest_in_words(every)] if every else []),
            *(f"left out: {why}" for why in shown.rest.left_out),
            *([asked.unrelated] if asked.unrelated else asked.one_material),
        ),
        seconds=seconds,
    )


def result_of(
    asked: Asked, divided: Divided, completed: Completed, *, shown: Shown, given: SensorModel, seconds: float
) -> Result:
    """The verdict with what was put in place first, the sensor model without what is not confirmed, and the evidence
    of both; `given` is what was known of the sensor, beside its control."""
    placed, added = asked.placed, completed.added
    grid, control = placed.comparison.scan.grid, placed.division.control
    verdict = verdict_of(asked, divided, completed, shown=shown, given=given, seconds=seconds)
    of_mounting = named_mounting(placed.mounting, placed.division.parts, rows=len(grid.elevation_rad))
    verdict = with_placed(without_unconfirmed(verdict, shown.apart), placed.of_drive.effects, how=placed.of_drive.how)
    by_ranges = how_placed(placed.comparison.scenes)
    verdict = with_placed(verdict, *of_mounting, how=by_ranges)
    if placed.knock:
        sure, others, regimes = named_knock(placed.knock, placed.comparison, placed.division.parts)
        verdict = with_placed(replace(verdict, regimes=(*regimes, *verdict.regimes)), sure, others, how=by_ranges)
    known = given.beside(control.mounting)
    effects_model = effects_model_of(verdict, added.effects_model, known).without(control.mounting.without(given))
    # What is not confirmed is not in the sensor model, and makes nothing of its levels.
    named_effects = dict(effects_model.effects)
    standing = [(refit.effect, refit.fit.z) for refit in added.refits if refit.effect.plain_name in named_effects]
    null = placed.found.null_model.problem
    levels = missing(shown.levels, made_by(null.ev, in_place(null, standing).ev))
    return Result(
        verdict,
        replace(effects_model, levels=levels),
        grid,
        *shown.maps,
        shown.judged.curves,
        completed.answer.choice.first_ranking,
        shown.judged.frames,
    )
