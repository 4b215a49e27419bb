"""What an effect is held to that passed the bar, before it is said: other sides, one class alone, sizes that matter."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jaxsim.discover.find.covariates import Dependence, parts_of
from jaxsim.discover.model.fit import Problem, on_top
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.each_class import denied_without, outdone_in, shown_below, shown_by
from jaxsim.discover.name.other_sides import CONTROL, EXCHANGED, OtherSides, looks_like_chance
from jaxsim.discover.name.select import FittedStep
from jaxsim.discover.rules import RULES
from jaxsim.effects import Law

SCARCE = f"no more than {100 * RULES.scarce_clutter:.1f} % of the rays return before what is simulated"
"""Of clutter."""
DENIED = "all other surfaces speak against it, without those of"
"""Followed by a class's name, and the next by one or more."""
OUTDONE = "another explains as much, and these surfaces show far less of this one than they would:"
"""Followed by a class's name."""
SHOWN_BY = "none but these surfaces show it, of which one side alone has some:"
OF_POSTS = "none but rays straight below very bright targets show it, where posts stand"
SHOWN_ELSEWHERE = {
    EXCHANGED: "what noise of both does to the comparison, nothing that one of them has and the other has not",
    CONTROL: "what the simulator lacks by itself, and nothing new",
    SCARCE: "what a beam of some width does on thin things, which a simulator that casts single rays misses",
}
"""What it means that something was found which is not said, by why."""
NEGLIGIBLE = f"less than {100 * RULES.negligible:.0f} % of what is clearly visible"
"""Of an effect's parameters, in their scales."""
UNFOUNDED = "the noise of neighbouring readings does not grow as echoes weaken"
OF_MATERIALS = "no class tells materials apart, and these alone make as much"
BY_PLACE = ("range", "row", "height")
"""Covariates by which materials stand: near by or far off, low or high ..."""
BY_MATERIAL = ("incidence", "class", "power", "intensity")
"""... those that differ from material to material ..."""
BY_SURFACE = (*BY_PLACE, *BY_MATERIAL)
"""... and both."""
RARELY_IF_EVER = "the interval of how often it acts holds never"


@dataclass(frozen=True)
class Doubts:
    """What there is to hold effects to."""

    others: Sequence[Callable[[], OtherSides]] = ()
    """What they show as well is passed over: the sides exchanged where the simulator has noise of its own, and the
    control's frames. They are asked where anything is found."""
    exchanged: Callable[[], OtherSides] | None = None
    """The sides exchanged of a simulator without noise, which are asked of what looks like chance alone."""
    noise_grows: Callable[[], bool] = lambda: True
    """Whether the noise of neighbouring readings, which knows nothing of poses and surfaces, grows as echoes weaken."""
    may_never_act: Callable[[FittedStep, Problem], bool] = lambda step, beside: False
    """Whether an effect that was fitted to a problem may never act, by the interval of its probability."""
    apart: Sequence[int] = ()
    """Classes whose surfaces are partly others on the two sides."""
    classless: bool = False
    """Whether the simulated frames tell no classes."""

    def against(self, step: FittedStep, beside: Problem, *, null: Problem) -> str:
        """Why an effect that would be added to the problem `beside` is none after all; empty where it is one."""
        # The first decides: what is asked later is not asked any more.
        return next(self._reasons(step, beside, null), "")

    def against_curve(self, along: Dependence, curve: Candidate, problem: Problem) -> str:
        """Why a free curve that was fitted to a problem is not said; empty where no other sides show it."""
        asked = self._others(by_chance=along.channel == "drop")
        of_surface = along.channel == "intensity" and {*parts_of(along.covariate)} <= {*BY_SURFACE}
        if of_surface and self._little(curve, problem):
            return OF_MATERIALS
        return next((sides.why for other in asked if (sides := other()).has_curve(problem, along, curve)), "")

    def _others(self, *, by_chance: bool) -> Sequence[Callable[[], OtherSides]]:
        return (self.exchanged, *self.others) if self.exchanged and by_chance else self.others

    def _reasons(self, step: FittedStep, beside: Problem, null: Problem) -> Iterator[str]:
        effect = step.chosen.effect
        asked = self._others(by_chance=looks_like_chance(effect))
        for other in asked:
            sides = other()
            # What neighbouring readings say for certain the sides exchanged cannot undo.
            certain = sides.why == EXCHANGED and self._noisier(effect)
            if not certain and sides.has(step, null):
                yield sides.why
        if effect.clutter and clutter_of(null, step) <= RULES.scarce_clutter:
            yield SCARCE
        if effect.name not in FINEST and step.chosen.size < RULES.negligible:
            yield NEGLIGIBLE
        if effect.name == "range_noise" and not self.noise_grows():
            yield UNFOUNDED
        if goes_by(effect, BY_SURFACE) and effect.name not in FINEST and self._little(step.chosen, null):
            yield OF_MATERIALS
        if alone := denied_without(step, beside):
            yield f"{DENIED} {alone}"
        if alone := outdone_in(step, beside):
            yield f"{OUTDONE} {alone}"
        if alone := shown_by(step, beside, self.apart):
            yield f"{SHOWN_BY} {alone}"
        if shown_below(step, beside):
            yield OF_POSTS
        # Of a rare event most scenes say nothing, and an interval over scenes holds never.
        if not step.chosen.sudden and self.may_never_act(step, beside):
            yield RARELY_IF_EVER

    def _little(self, found: Candidate, problem: Problem) -> bool:
        """Whether materials that no class tells apart gain as much as what was found, ray by ray."""
        if not self.classless:
            return False
        compared = int(np.asarray(problem.ev.compared).sum())
        return found.total < RULES.materials_nats * compared / 1000

    def _noisier(self, effect: Law) -> bool:
        """Whether neighbouring readings show for certain that the measured side has this noise and the other has not:
        what both have cannot, for the sides exchanged would show the reverse."""
        return effect.name == "range_noise" and self.noise_grows()


NO_DOUBTS = Doubts()


def goes_by(effect: Law, covariates: Sequence[str]) -> bool:
    """Whether an effect changes intensities alone, by these covariates alone: of some materials look like that."""
    return effect.channels == ("intensity",) and bool(effect.covariates) and {*effect.covariates} <= {*covariates}


def clutter_of(null: Problem, step: FittedStep) -> float:
    """The share of false returns before surfaces that an effect adds, over all rays."""
    rays = on_top(step.chosen.effect, null, step.fit.z).ev.rays
    return float(np.mean(np.asarray(rays.clutter) - np.asarray(null.ev.rays.clutter)))
