"""Which of the named effects act in a part of the recording alone, where, and what they are there; and such a regime as
the verdict holds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxsim.discover.find.division import AllScenes, Division, NullModel
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.name.answer import Answer, named_answer, outdone, stands
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.discover.name.select import Choice, FittedStep, needless, with_steps, worse
from jaxsim.discover.name.unexplained import curve_numbers
from jaxsim.discover.read.control import NO_CONTROL
from jaxsim.discover.regimes.confine import confine, sharpened
from jaxsim.discover.regimes.judge import JudgeScenes
from jaxsim.discover.regimes.leads import Lead, of_candidates, of_named, ranked, rivals, without_step
from jaxsim.discover.regimes.questions import Facts, questions
from jaxsim.discover.regimes.sizes import Sized, least_size, sized, sizes_at
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Regime
from jaxsim.effects.region import Region
from jaxsim.progress import Log


def regime_of(sizes: Sized, lead: Lead, judge_nats: float, *, facts: Facts) -> Regime:
    """The verdict's entry, with the size that each scene or sector asks for."""
    confined, divides = sizes.confined, lead.finding.question.divides
    least = least_size(confined.plain)
    azimuth = np.asarray(facts.scan.grid.azimuth_rad, float)
    columns = np.asarray(confined.region.in_sector(azimuth))
    counted = False
    if divides == "azimuth":
        x = azimuth[[(2 * k + 1) * len(azimuth) // (2 * facts.sectors) for k in range(facts.sectors)]]
        size = sizes_at(sizes.slopes, facts.sector, facts.sectors, least=least)
        inside = np.asarray(confined.region.in_sector(x))
    else:
        # Of a single drive, whose sectors are its scenes, each has all moments: frames are shown instead.
        group = facts.scene if len(set(facts.names)) > 1 else np.unique(facts.frame, return_inverse=True)[1]
        of_column = np.broadcast_to(group[:, None], facts.column.shape)
        size = sizes_at(sizes.slopes, of_column, int(group.max()) + 1, least=least)
        first = np.unique(group, return_index=True)[1]
        time_s = np.asarray(facts.scan.time_s, float)[facts.frame[first]]
        counted = len(np.unique(time_s)) < len(first)
        x = np.arange(len(first), dtype=float) if counted else time_s
        inside = confined.frames[facts.frame[first]]
    return Regime(
        effect=confined.plain.plain_name,
        divides=divides,
        where=confined.region,
        share=float(confined.frames.mean() * columns.mean()),
        inside=sizes.inside,
        outside=sizes.outside,
        p_value=lead.finding.p_value,
        q_value=lead.q_value,
        judge_nats=judge_nats,
        applied=confined.region.acts,
        x=tuple(map(float, x)),
        sizes=tuple(map(float, size)),
        held=tuple(map(bool, inside)),
        counted=counted,
    )


@dataclass(frozen=True)
class Divided:
    """An answer in which some effects act in a part alone."""

    answer: Answer
    regimes: tuple[Regime, ...] = ()

    @property
    def regions(self) -> dict[str, Region]:
        """Each effect's region."""
        return {regime.effect: regime.where for regime in self.regimes}


def facts_of(division: Division) -> Facts:
    """The facts of the find scenes' blocks."""
    keep, scene = division.blocks_of(division.parts.find)
    return Facts(division.scan, division.scenes, division.blocks.frame[keep], scene, division.blocks.column[keep])


def find_regimes(
    model: NullModel, answer: Answer, *, without: Sequence[str] = (), log: Log = lambda line: None
) -> Divided:
    """Asks of every named effect, or where none is named of the candidates, what divides it; those that act in a part
    alone are fitted there, and take the place of the same effects everywhere. Beside them no free curve is asked of the
    channels `without`."""
    null = model.problem
    facts = facts_of(model.division)
    controlled = model.division.control is not NO_CONTROL
    asked = questions(facts)
    choice = answer.choice
    regimes: list[Regime] = []
    judge_scenes = None
    for stage in (of_named, of_candidates):
        # What is named comes first; other candidates are asked about where nothing divides it.
        for lead in [] if regimes else ranked(stage(null, choice, facts=facts, asked=asked)):
            # Drives that only their own readings tell apart may be those that the simulator serves ill by itself.
            beside = lead.step is None and lead.finding.question.divides == "scene" and controlled
            if beside or not _promising(lead, choice, regimes):
                continue
            sizes = _sized(lead, null, choice, facts=facts)
            if sizes is None:
                continue
            # They are dear to make, and mostly nobody asks them.
            judge_scenes = judge_scenes or JudgeScenes.of(AllScenes.of(model))
            trial = _with(null, choice, sizes.confined.step, at=lead.step)
            # The free curve for which nothing was named may explain clearly more of a channel than an effect in a part,
            # too; what that says in other channels stands.
            curve = answer.curve if lead.step is None and not stands_beside(answer, sizes) else None
            if curve and outdone(trial, *curve, numbers=curve_numbers(null, curve[0])):
                continue
            confined, gained = judge_scenes.gained(sizes.confined, trial, choice, facts=facts)
            if gained <= 0:
                continue
            log(f"{confined.plain.name} acts in a part alone: {confined.advantage:.0f} nats more than everywhere")
            # Judge scenes may have joined the region.
            choice = _with(null, choice, confined.step, at=lead.step)
            regimes.append(regime_of(sizes._replace(confined=confined), lead, gained, facts=facts))
    if not regimes:
        return Divided(answer)
    choice = _needed(null, choice, log=log)
    named = named_answer(choice, without=without, but=answer.unasked)
    said = {name: getattr(named, name) for name in ("verdict", "choice", "unexplained", "curve")}
    # What else the answer knows (nulls, what was found and is not said) holds of the parts as well.
    return Divided(replace(answer, **said), tuple(regimes))


def _needed(null: Problem, choice: Choice, *, log: Log) -> Choice:
    """The choice without effects that only mended what another did wrong while it acted everywhere."""
    # `needless` takes the last for granted: those with a region are.
    steps = sorted(choice.steps, key=lambda step: step.chosen.effect.name != step.chosen.effect.plain_name)
    gone: list[str] = []
    while (k := needless(null, steps, choice.bars, log=log)) is not None:
        gone.append(steps.pop(k).chosen.effect.plain_name)
    if not gone:
        return choice
    kept = tuple(step for step in choice.steps if any(step is one for one in steps))
    problem = with_steps(null, kept)
    return replace(choice, steps=kept, problem=problem, needless=(*choice.needless, *gone))


def stands_beside(answer: Answer, sizes: Sized) -> bool:
    """Whether an effect in its region stays named whatever the answer's free curve explains, if it has one."""
    return answer.curve is None or stands(sizes.confined.step, answer.curve[0].channel)


def _promising(lead: Lead, choice: Choice, regimes: Sequence[Regime]) -> bool:
    """Whether it is sure enough, and its effect has no region yet; of candidates while there is none at all."""
    free = not regimes
    if lead.named and lead.step is not None:
        free = choice.steps[lead.step].chosen.effect.plain_name not in {regime.effect for regime in regimes}
    return free and lead.exists and lead.q_value <= RULES.regime_level


def _sized(lead: Lead, null: Problem, choice: Choice, *, facts: Facts) -> Sized | None:
    """The lead's effect fitted in its region; None where it gains too little by it, or may act outside as well."""
    region = lead.finding.question.regions[lead.finding.k]
    problem = without_step(null, choice, lead.step)
    if lead.fit and region.azimuth_rad:
        region = sharpened(region, lead.candidates[0].effect, lead.fit, problem=problem, facts=facts)
    candidates = (lead.candidates[0], *rivals(lead, problem, facts))
    if len(choice.steps) > 1:
        # Gains of a step were those over the steps before it alone.
        again = {c.effect.name: c for c in rank_effects(problem, [c.effect for c in candidates])}
        candidates = tuple(again[c.effect.name] for c in candidates)
    ranking = choice.first_ranking if lead.step is None else choice.steps[lead.step].ranking
    confined = confine(problem, candidates, region, facts=facts, ranking=ranking)
    if confined is None:
        return None
    chosen = confined.step.chosen
    # All scenes have their share of a sector: of an effect that is not named yet they must agree.
    if lead.step is None and region.azimuth_rad and not chosen.accepted(choice.bars.effect):
        return None
    # Another effect takes the place of a named one if it is clearly better.
    if lead.step is not None and not lead.named and not worse(choice.steps[lead.step].chosen, chosen):
        return None
    # What may act outside as well is no regime, however much it gains inside; nor is what may be as little inside.
    sizes = sized(confined, facts)
    apart = sizes.outside.high < min(RULES.regime_outside * sizes.inside.value, sizes.inside.low)
    return sizes if apart else None


def _with(null: Problem, choice: Choice, confined: FittedStep, *, at: int | None) -> Choice:
    """The choice with an effect in its region in place of the same everywhere."""
    steps = list(choice.steps)
    if at is None:
        steps.append(confined)
    else:
        steps[at] = confined
    return replace(choice, steps=tuple(steps), problem=with_steps(null, steps))
