"""The whole method: find, name, add, repeat, show."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

from jaxsim.devices import by_small_steps, side_by_side
from jaxsim.discover.add import Added, add_effects, changes
from jaxsim.discover.contrast import contrast_of_answer, contrast_off
from jaxsim.discover.division import NOTHING_YET, Division
from jaxsim.discover.explain import (
    named,
    notes,
    nuisance_changes,
    own_candidates,
    ranking,
    why_not,
)
from jaxsim.discover.find import Dependences, find_dependences
from jaxsim.discover.law.learn import curve_form, leaves_nothing
from jaxsim.discover.law.search import closed_law
from jaxsim.discover.levels import compare_levels, made_by, missing, range_noise_grows
from jaxsim.discover.look_alikes import with_look_alikes
from jaxsim.discover.model.fit import in_place
from jaxsim.discover.model.null import refitted
from jaxsim.discover.mounting import BY_RANGES, named_mounting, place_mounting, refine_lift, registered_of
from jaxsim.discover.name.answer import Answer, name_effects, without_curve
from jaxsim.discover.name.other_sides import OtherSides
from jaxsim.discover.name.select import Log
from jaxsim.discover.objects import compare_objects
from jaxsim.discover.one_drive import ask_pieces
from jaxsim.discover.read import Comparison, read_comparison
from jaxsim.discover.read.control import NO_CONTROL, Control
from jaxsim.discover.regimes.find import Divided, find_regimes
from jaxsim.discover.repeats.examine import examine, formula_of, one_sided, with_repeats, with_what_repeats
from jaxsim.discover.repeats.learn import LearnedRepeat
from jaxsim.discover.sensitivity import correlations, of_ranges, sensitivities, unrelated
from jaxsim.discover.show import law_gains, sensor_of, show_gap, with_placed, without_unconfirmed
from jaxsim.discover.show.every_frame import HeldAnswer, judge_rest, rest_in_words
from jaxsim.discover.verdict import InPlace, Result, Verdict, Where
from jaxsim.effects import EFFECTS, Effect, get_effect
from jaxsim.effects.chain import SensorModel

HIDDEN_BY_NOISE = (("intensity", "rgb"), ("intensity", "hue"), ("intensity", "hue angle"))
"""What noise on the simulator's intensities hides of its surfaces, colours tell: a curve along these is no sensor's."""
HIDDEN_BY_CONTRAST = (*HIDDEN_BY_NOISE, ("intensity", "intensity"), ("intensity", "power"))
"""Where the sensor does not follow the simulator's contrast, readings regress to the mean, by a curve of their own: a
curve along the intensity is no sensor's either."""


def discover_folders(
    *,
    simulated: Path,
    measured: Path,
    effects: Iterable[str] | None = None,
    known: SensorModel = NOTHING_YET,
    control: Control = NO_CONTROL,
    nulls: int = 0,
    every_frame: bool = False,
    log: Log = lambda line: None,
) -> Result:
    """`discover` on two folders of polar frames (docs/polar-frames.md), beside the `control` of an earlier answer."""
    control.check_new(simulated, measured)
    comparison = replace(read_comparison(simulated, measured), control=control)
    return discover(comparison, effects=effects, known=known, nulls=nulls, every_frame=every_frame, log=log)


@by_small_steps
def discover(
    comparison: Comparison,
    *,
    effects: Iterable[str] | None = None,
    known: SensorModel = NOTHING_YET,
    nulls: int = 0,
    every_frame: bool = False,
    log: Log = lambda line: None,
) -> Result:
    """Finds where simulation and measurement disagree, names the missing effect, adds it, and shows what is left.

    `effects` are the candidates, by default the whole catalogue and the effects of one's own that were loaded
    (`jaxsim.effects.own.known_effects`). `known` is what the sensor model already has and the
    simulated frames do not show: it is put in place first, as it stands, and no candidate. So an answer can be fed
    back. `nulls` asks to set the bar on so many measurements drawn from these very data, in which nothing is missing:
    what is named must gain more than anything did on any of them. `every_frame` also judges what was named on the
    frames that were not read because so many do not fit. `log` is given lines on the progress.

    Raises ValueError where the scenes are too few to decide anything, for unknown effects and for a negative number.
    """
    begun = time.monotonic()
    if nulls < 0:
        raise ValueError(f"discover: nulls is {nulls}; give how many to draw, 20 or more to calibrate, or 0 for none")
    control = comparison.control
    given, known = known, known.beside(control.mounting)
    modelled = known.names
    catalogue = [get_effect(name) for name in (EFFECTS if effects is None else effects) if name not in modelled]

    # Register: a mounting that is clearly off is put in place first, for nothing else can be asked across it.
    mounting = place_mounting(comparison, [effect.name for effect in catalogue], known)
    catalogue = [effect for effect in catalogue if effect.name not in mounting.effects]
    division = Division.of(mounting.comparison)
    parts = division.parts
    log(f"{len(parts.find)} scenes to find with, {len(parts.judge)} to judge on: split {parts.sha256}")

    # Find: the null model with its nuisances, and what its residuals still depend on.
    found = find_dependences(division, mounting.known)
    finer = refine_lift(comparison, mounting, found.null.problem, known=known)
    # What the null says rests on where the sensor stands: it is asked again from there.
    if finer is not mounting:
        mounting, division = finer, Division.of(finer.comparison)
        found = find_dependences(division, mounting.known)
    of_drive = ask_pieces(found.null, catalogue, log=log)
    if of_drive.effects:
        mounting = replace(mounting, known=of_drive.known)
        catalogue = [effect for effect in catalogue if effect.name not in dict(mounting.known.effects)]
        found = find_dependences(division, mounting.known)
    comparison, null = mounting.comparison, found.null.problem
    unrelated_note = unrelated(correlations(null.ev, found.null.scene))
    if unrelated_note:
        catalogue = [effect for effect in catalogue if of_ranges(effect)]

    # Name: the catalogue, one effect after another; then free curves for what is not in it.
    catalogue = with_look_alikes(catalogue, null.ev.rays, null.scan)
    log(f"fitting {len(catalogue)} effects")
    without = ("intensity",) if unrelated_note else ()
    beside = cache(partial(sides_of, control, *control.folders)) if control.folders else None
    asked = partial(
        answer_of, comparison, catalogue=catalogue, nulls=nulls, without=without, control_sides=beside, log=log
    )
    answer, others = asked(found)
    contrast = None if unrelated_note else contrast_off(found.null, answer.choice)
    if contrast:
        log(f"the sensor does not follow the simulator's contrast ({contrast.total:.0f} nats): all is asked beside it")
        division = division.with_free_contrast()
        found = find_dependences(division, mounting.known)
        null = found.null.problem
        answer, others = asked(found)

    # Regimes: effects that act in a part of the recording alone take the place of the same everywhere.
    divided = find_regimes(found.null, answer, without=without, log=log)

    # Add: every effect fitted again with the others in place, and what repeats in the sensor's own coordinates.
    fitted = fit_answer(found, divided, others, log=log)
    answer, added = fitted.answer, fitted.added
    choice = answer.choice

    # Show: the scenes that nothing has seen.
    log("judging on unseen scenes")
    shown, (levels, objects, sensitive) = side_by_side(
        partial(show_gap, found.null, choice, added),
        lambda: (compare_levels(comparison), compare_objects(comparison), sensitivities(null, catalogue)),
    )
    maps = shown.maps_before, shown.maps_after
    every = None
    if every_frame and comparison.rest:
        log(f"judging the other {len(comparison.rest.names)} frames")
        held = HeldAnswer(found.null, added.chain, choice.problem.noise)
        every, maps = judge_rest(comparison, mounting, held) or (None, maps)
    verdict = Verdict(
        verdict=answer.verdict,
        effects=tuple(
            named(step, values, does=changes(null, one))
            for step, values, one in zip(choice.steps, added.parameters, added.refits, strict=True)
        ),
        frames=len(comparison.names),
        where=found.where,
        unexplained=answer.unexplained,
        gap=shown.gap,
        closure=shown.closure,
        find=parts.find,
        judge=parts.judge,
        sha256=parts.sha256,
        moved=nuisance_changes(null, choice, [one.fit.z for one in added.refits]),
        ranking=ranking(choice, why_not, bar=choice.bars.effect),
        nulls=answer.nulls,
        levels=levels,
        contrast=contrast_of_answer(contrast, choice.problem) if contrast else None,
        control=InPlace(control.model.names, control.contrast_off) if control is not NO_CONTROL else None,
        objects=objects,
        own=own_candidates(choice),
        learned=added.sensor.learned[len(mounting.known.learned) :],
        law=closed_law(added.learned) if added.learned else formula_of(fitted.repeats),
        repeats=tuple(one.repeat for one in fitted.repeats),
        every_frame=every,
        regimes=divided.regimes,
        registered=registered_of(comparison),
        unrelated=unrelated_note is not None,
        sensitivity=sensitive,
        notes=(
            *notes(comparison, division, answer, held=given.names),
            *([rest_in_words(every)] if every else []),
            *([unrelated_note] if unrelated_note else []),
        ),
        seconds=time.monotonic() - begun,
    )
    of_mounting = named_mounting(mounting, parts, rows=len(null.scan.grid.elevation_rad))
    verdict = with_placed(without_unconfirmed(verdict), of_drive.effects, how=of_drive.how)
    verdict = with_placed(verdict, *of_mounting, how=BY_RANGES)
    sensor = sensor_of(verdict, added.sensor, known).without(control.mounting.without(given))
    # What is not confirmed is not in the sensor model, and makes nothing of its levels.
    standing = [(one.effect, one.fit.z) for one in added.refits if one.effect.plain_name in dict(sensor.effects)]
    sensor = replace(sensor, levels=missing(levels, made_by(null.ev, in_place(null, standing).ev)))
    return Result(verdict, sensor, comparison.scan.grid, *maps, shown.curves, choice.first_ranking, shown.frames)


def sides_of(control: Control, simulated: Path, measured: Path) -> OtherSides:
    """The control's frames, to which what is about to be said of others is held.

    Raises ValueError where they are none any more."""
    comparison = replace(read_comparison(simulated, measured), control=control)
    return OtherSides.of_control(place_mounting(comparison, (), control.mounting).comparison)


def answer_of(
    comparison: Comparison,
    found: Dependences,
    *,
    catalogue: Sequence[Effect],
    nulls: int,
    without: Sequence[str],
    control_sides: Callable[[], OtherSides] | None,
    log: Log,
) -> tuple[Answer, Sequence[Callable[[], OtherSides]]]:
    """What naming says of what was `found`, and the other sides that it asked: the sides exchanged where the simulator
    has noise, and the control's frames where they are there."""
    null, simulator = found.null.problem, found.null.division.simulator
    others: list[Callable[[], OtherSides]] = []
    if simulator.noisy:
        # Of a simulator without noise the sides are no two readings of one street.
        others.append(cache(partial(OtherSides.exchanged, comparison, found.null)))
    if control_sides:
        others.append(control_sides)
    answer = name_effects(
        null,
        catalogue,
        found.single,
        scene=found.null.scene,
        nulls=nulls,
        without=without,
        unasked=HIDDEN_BY_CONTRAST if simulator.free_contrast else HIDDEN_BY_NOISE if simulator.intensities else (),
        others=others,
        noise_grows=cache(partial(range_noise_grows, comparison)),
        leaves_nothing=lambda curve, effects, bar: leaves_nothing(null, curve, effects, bar=bar),
        log=log,
    )
    return answer, others


@dataclass(frozen=True)
class FittedAnswer:
    """What was named, with all of it fitted together."""

    answer: Answer
    """The answer, with what repeats; its choice has the problem with all that was added in place."""
    added: Added
    repeats: tuple[LearnedRepeat, ...]


def fit_answer(
    found: Dependences, divided: Divided, others: Sequence[Callable[[], OtherSides]], *, log: Log
) -> FittedAnswer:
    """What was named, fitted together; a law for what no effect describes; and laws of what repeats at the same rows
    and columns in every scene with these in place, but does not on `others`, other sides."""
    log("fitting what was named together")
    null, known = found.null.problem, found.null.known
    answer, choice = divided.answer, divided.answer.choice
    form = None
    if answer.curve:
        form = curve_form(choice.problem, *answer.curve, crossed=found.crossed, bar=choice.bars.free)
    added = add_effects(null, choice.steps, known=known, form=form, regions=divided.regions)
    effects = [step.placed for step in choice.steps]
    if added.learned and not law_gains(found.null, added, before=choice.problem, effects=effects):
        log(f"{added.learned.learned.name}: scenes that it was not fitted to do not gain by it")
        answer = without_curve(answer)
        added = add_effects(null, choice.steps, known=known, regions=divided.regions)
    if added.learned:
        log(f"{added.learned.learned.name}: no effect of the catalogue, added as it is")
        # The law leaves less noise than there was: what is asked next must know it.
        choice = replace(choice, problem=refitted(in_place(null, added.chain)))
    log("looking for what repeats")
    repeats = examine(found.null, added.chain, choice.problem.noise)
    for other in others if repeats else ():
        repeats, passed = one_sided(repeats, sides := other())
        answer = replace(answer, elsewhere=(*answer.elsewhere, *((formula, sides.why) for formula in passed)))
    if repeats:
        log(f"{repeats[0].repeat.formula}, in every scene: no effect of the catalogue, added as it is")
        added = with_repeats(added, [one.learned for one in repeats])
        choice = replace(choice, problem=refitted(in_place(null, added.chain)))
        answer = with_what_repeats(answer, repeats[0])
    return FittedAnswer(replace(answer, choice=choice), added, repeats)


@by_small_steps
def disagreements(comparison: Comparison) -> tuple[Where, ...]:
    """Only the first step of `discover`, in seconds: on which covariates the find scenes' residuals depend, strongest
    first. Raises ValueError where the scenes are too few to decide anything."""
    mounting = place_mounting(comparison, {*EFFECTS})
    return find_dependences(Division.of(mounting.comparison), mounting.known).where
