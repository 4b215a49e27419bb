"""What judge scenes, to which nothing was fitted, say of an effect in its region: where it ends between find scenes,
and whether they gain by it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.division import AllScenes
from jaxsim.discover.model.fit import Fit, Problem, all_on_top, on_top
from jaxsim.discover.model.likelihood import log_likelihood
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.name.select import Choice
from jaxsim.discover.regimes.confine import Confined, frames_in
from jaxsim.discover.regimes.questions import Facts
from jaxsim.effects import Law
from jaxsim.effects.region import Region, within


@dataclass(frozen=True)
class JudgeScenes:
    """All scenes with the null in place."""

    scenes: AllScenes
    base: Problem
    """The null there."""

    @classmethod
    def of(cls, scenes: AllScenes) -> JudgeScenes:
        """All scenes of a null model."""
        return cls(scenes, scenes.problem_with())

    def halves(self) -> tuple[JudgeScenes, JudgeScenes]:
        """The same scenes with every second column alone: even ones, and odd ones."""
        return self._every_second(0), self._every_second(1)

    def _every_second(self, first: int) -> JudgeScenes:
        division = self.scenes.division
        chosen = replace(division.blocks, column=division.blocks.column[:, first::2])
        return JudgeScenes.of(AllScenes.of(self.scenes.null_model, division.looking_at(chosen)))

    def likelihood(self, problem: Problem, noise: Noise) -> Float[np.ndarray, " b"]:
        """Each block's log-likelihood, nats, at the weights of the null."""
        at = {"equations": self.base.equations, "in_fit": self.scenes.in_fit, "clutter": problem.clutter}
        return np.asarray(log_likelihood(problem.ev, noise, **at)).sum(-1)

    def gained(self, confined: Confined, trial: Choice, choice: Choice, *, facts: Facts) -> tuple[Confined, float]:
        """The effect in its region, and what judge scenes gain with the choice `trial`, in which it acts there alone,
        over `choice`.

        What find scenes leave open of the region, judge scenes say by their even columns: which of them it holds where
        drives' own readings alone divide them, and where between two find scenes its moments lie. Their odd columns say
        what they gain, for scenes that are asked whether they would gain and then join cannot but gain."""
        judging = self
        region = confined.region
        if region.scenes or (region.time_s and len(set(facts.names)) > 1):
            choosing, judging = self.halves()
            wider = (
                choosing._with_drives(confined, facts) if region.scenes else choosing._between_moments(confined, facts)
            )
            confined, trial = _in_region(wider, confined, trial, facts=facts)
        # At the equations of one null, each with the noise that it leaves: what differs is the region alone.
        judged = judging.scenes.in_fit == 0
        return confined, float((judging._with(trial) - judging._with(choice))[judged].sum())

    def _with(self, choice: Choice) -> Float[np.ndarray, " b"]:
        """Each block's log-likelihood with what is chosen in place."""
        chosen = all_on_top([step.placed for step in choice.steps], self.base, simulated=True)
        return self.likelihood(chosen, choice.problem.noise)

    def gains_with(self, law: Law, result: Fit) -> Float[np.ndarray, " b"]:
        """What each block gains with an effect as it was fitted elsewhere over none, nats."""
        # As a simulation has it: readings that were reported have no say in what is held against them.
        everywhere = on_top(law, self.base, result.z, simulated=True)
        return self.likelihood(everywhere, result.noise) - self.likelihood(self.base, self.base.noise)

    def _with_drives(self, confined: Confined, facts: Facts) -> Region:
        """The region with the judge scenes that are likelier with the effect than without it."""
        better = self.gains_with(confined.plain, confined.step.fit) > 0
        judged = self.scenes.in_fit == 0
        names = {facts.names[k] for k in self.scenes.division.blocks.frame[judged & better].tolist()}
        return Region(scenes=tuple(sorted({*confined.region.scenes, *names})))

    def _between_moments(self, confined: Confined, facts: Facts) -> Region:
        """The region with each of its moments where judge scenes between the same two find scenes gain most by it."""
        gain = self.gains_with(confined.plain, confined.step.fit)
        drive = np.unique(facts.names, return_inverse=True)[1]
        moment = (np.bincount(drive, np.asarray(facts.scan.time_s, float)) / np.bincount(drive))[drive]
        judged = self.scenes.in_fit == 0
        of_block = moment[self.scenes.division.blocks.frame]
        first, last = confined.region.time_s or (None, None)
        moments = {"found": np.unique(of_block[~judged]), "moment": of_block[judged], "gain": gain[judged]}
        begin = None if first is None else best_moment(first, after=True, **moments)
        end = None if last is None else best_moment(last, after=False, **moments)
        return replace(confined.region, time_s=(begin, end))


def best_moment(
    cut: float,
    *,
    found: Float[np.ndarray, " n"],
    moment: Float[np.ndarray, " m"],
    gain: Float[np.ndarray, " m"],
    after: bool,
) -> float:
    """A cut between two of the moments `found`, moved to where what lies on its side gains most: of the others there,
    each at its moment, that gain so much by the effect, `after` it or before. It stays where none lies there."""
    below, above = found[found < cut].max(), found[found >= cut].min()
    between = (moment > below) & (moment < above)
    if not between.any():
        return cut
    order = np.concatenate([[below], np.unique(moment[between]), [above]])
    cuts = (order[1:] + order[:-1]) / 2
    inside = (moment >= cuts[:, None]) == after
    return float(cuts[np.argmax((inside & between) @ gain)])


def _in_region(region: Region, confined: Confined, trial: Choice, *, facts: Facts) -> tuple[Confined, Choice]:
    """The effect in another region, and the choice with it there."""
    if region == confined.region:
        return confined, trial
    frames = frames_in(region, facts)
    law = within(confined.plain, region, frames)
    step = replace(confined.step, chosen=replace(confined.step.chosen, effect=law))
    old = confined.step.chosen.effect
    steps = tuple(step if one.chosen.effect is old else one for one in trial.steps)
    return replace(confined, step=step, region=region, frames=frames), replace(trial, steps=steps)
