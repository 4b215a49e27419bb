"""A step of all intensities in time: a gain that switches, which no effect describes and no residual shows.

Effects that only mend what a step does to the levels of scenes have nothing to say beside it, as a drift has, which is
a line through one. An effect that acts from a moment on steps too: which of both it is `regimes` asks, of what is said
here.
"""

from __future__ import annotations

from dataclasses import replace

from jaxsim.discover.find.covariates import Dependence
from jaxsim.discover.find.moments import steps_in_time
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.name.answer import Answer, Beside, curve_in_words
from jaxsim.discover.name.doubts import Doubts
from jaxsim.discover.name.select import FittedStep, with_steps
from jaxsim.discover.name.unexplained import agreed, curve_along, describe_curve
from jaxsim.discover.rules import RULES
from jaxsim.progress import Log

IN_TIME = ("intensity", "frame")
"""Channel and covariate of a step in time."""


def stepped(null: Problem, answer: Answer, *, doubts: Doubts, beside: Beside, log: Log) -> Answer:
    """The answer with the curve of a step in time, where there is one and no other curve says more; without what is
    named of intensities and has nothing to say with that in place."""
    choice = answer.choice
    steps = () if IN_TIME in answer.unasked else steps_in_time(null)
    if not steps:
        return answer
    along = Dependence(*IN_TIME, p_value=1.0, share=0.0, gain=0.0, steps=steps)
    curve = curve_along(null, along)
    other = answer.curve is not None and answer.curve[1].total > curve.total
    if other or not agreed(curve, choice.bars.free):
        return answer
    if why := doubts.against_curve(along, curve, null):
        log(f"{curve_in_words(IN_TIME)}, not said: {why}")
        return replace(answer, unasked=(*answer.unasked, IN_TIME))
    asked = [step for step in choice.steps if _may_mend(step)]
    again = beside((along, curve), [step.chosen.effect for step in asked], choice.bars.effect) if asked else ()
    total = {candidate.effect.name: candidate.total for candidate in again if candidate.accepted(choice.bars.effect)}
    gone = [step for step in asked if total.get(step.chosen.effect.name, 0.0) < RULES.weak_share * step.chosen.total]
    if gone:
        kept = tuple(step for step in choice.steps if step not in gone)
        choice = replace(choice, steps=kept, problem=with_steps(null, kept) if kept else null)
    if choice.steps:
        curve = curve_along(choice.problem, along)
        if not agreed(curve, choice.bars.free):
            return answer
    log(f"{curve_in_words(IN_TIME)}: {curve.total:.0f} nats, steps at {', '.join(f'{at:.0f} s' for at in steps)}")
    verdict = "named" if choice.steps else "not_in_catalogue"
    said = describe_curve(choice.problem, along, curve)
    return replace(answer, verdict=verdict, choice=choice, unexplained=said, curve=(along, curve))


def _may_mend(step: FittedStep) -> bool:
    """Whether an effect may only mend what a step in time does: one of intensities, and no lattice."""
    effect = step.chosen.effect
    return "intensity" in effect.channels and effect.name not in FINEST
