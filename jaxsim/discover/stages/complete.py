"""Complete: what was named, all of it fitted together; a law for what no effect describes; and what still repeats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from jaxsim.discover.add import Added, add_effects
from jaxsim.discover.find.dependences import Dependences
from jaxsim.discover.law.learn import curve_form
from jaxsim.discover.model.fit import in_place
from jaxsim.discover.model.null_model import refitted
from jaxsim.discover.name.answer import Answer, without_curve
from jaxsim.discover.name.other_sides import OtherSides
from jaxsim.discover.regimes.find import Divided
from jaxsim.discover.repeats.examine import examine, left_open, one_sided, with_repeats, with_what_repeats
from jaxsim.discover.repeats.learn import LearnedRepeat
from jaxsim.discover.show import law_gains
from jaxsim.progress import Log


@dataclass(frozen=True)
class Completed:
    """What was named, with all of it fitted together."""

    answer: Answer
    """The answer, with what repeats; its choice has the problem with all that was added in place."""
    added: Added
    repeats: tuple[LearnedRepeat, ...]


def complete(
    found: Dependences, divided: Divided, others: Sequence[Callable[[], OtherSides]], *, log: Log
) -> Completed:
    """What was named, fitted together; a law for what no effect describes; and laws of what repeats at the same rows
    and columns in every scene with these in place, but does not on `others`, other sides."""
    log("fitting what was named together")
    null, known = found.null_model.problem, found.null_model.known
    answer, choice = divided.answer, divided.answer.choice
    form = None
    if answer.curve:
        form = curve_form(choice.problem, *answer.curve, crossed=found.crossed, bar=choice.bars.free)
    added = add_effects(null, choice.steps, known=known, form=form, regions=divided.regions)
    effects = [step.placed for step in choice.steps]
    if added.learned and not law_gains(found.null_model, added, before=choice.problem, effects=effects):
        log(f"{added.learned.learned.name}: scenes that it was not fitted to do not gain by it")
        answer = without_curve(answer)
        added = add_effects(null, choice.steps, known=known, regions=divided.regions)
    if added.learned:
        log(f"{added.learned.learned.name}: no effect of the catalogue, added as it is")
        # The law leaves less noise than there was: what is asked next must know it.
        choice = replace(choice, problem=refitted(in_place(null, added.chain)))
    log("looking for what repeats")
    repeats = tuple(
        one for one in examine(found.null_model, added.chain, choice.problem.noise) if not left_open(one, added)
    )
    for other in others if repeats else ():
        repeats, passed = one_sided(repeats, sides := other())
        answer = replace(answer, elsewhere=(*answer.elsewhere, *((formula, sides.why) for formula in passed)))
    if repeats:
        log(f"{repeats[0].repeat.formula}, in every scene: no effect of the catalogue, added as it is")
        added = with_repeats(added, [repeat.learned for repeat in repeats])
        choice = replace(choice, problem=refitted(in_place(null, added.chain)))
        answer = with_what_repeats(answer, repeats[0])
    laws = tuple(law.on(null.scan.grid) for law in added.effects_model.learned)
    added = replace(added, effects_model=replace(added.effects_model, learned=laws))
    return Completed(replace(answer, choice=choice), added, repeats)
