"""What judge scenes, to which nothing was fitted, say of a region: whether they gain by it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.fit import Problem, all_on_top, on_top
from jaxsim.discover.model.likelihood import log_likelihood
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.null import with_own_weights
from jaxsim.discover.name.select import Choice
from jaxsim.discover.read import Division
from jaxsim.discover.regimes.confine import Confined
from jaxsim.discover.regimes.questions import Facts
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.region import Region, within


@dataclass(frozen=True)
class Judges:
    """All scenes with the null in place."""

    base: Problem
    scene: Int[np.ndarray, " b"]
    fitted: Float[np.ndarray, " b"]
    """1 for the find scenes."""
    frame: Int[np.ndarray, " b"]

    @classmethod
    def of(cls, division: Division, null: Problem, known: SensorModel) -> Judges:
        """All find and judge scenes of a division."""
        ev, scene = division.all_evidence(known)
        fitted = (scene < len(division.parts.find)).astype(np.float32)
        base = Problem(division.scan, ev, null.equations, null.noise, null.clutter)
        return cls(with_own_weights(base, fitted), scene, fitted, division.blocks.frame)

    def likelihood(self, problem: Problem, noise: Noise) -> Float[np.ndarray, " b"]:
        """Each block's log-likelihood, nats, at the weights of the null."""
        equations = self.base.equations
        by_channel = log_likelihood(problem.ev, noise, equations=equations, fitted=self.fitted, clutter=problem.clutter)
        return np.asarray(by_channel).sum(-1)

    def gained(self, one: Confined, trial: Choice, choice: Choice, *, facts: Facts) -> tuple[Confined, float]:
        """The effect in its region, and what judge scenes gain with the choice `trial`, in which it acts there alone,
        over `choice`. Where only drives' own readings divide them, the judge scenes that it suits join its region."""
        judged = self.fitted == 0
        if one.region.scenes:
            one, trial = self._joined(one, trial, facts)
        # At the equations of one null, each with the noise that it leaves: what differs is the region alone.
        return one, float((self._with(trial) - self._with(choice))[judged].sum())

    def _with(self, choice: Choice) -> Float[np.ndarray, " b"]:
        """Each block's log-likelihood with what is chosen in place."""
        chosen = all_on_top([step.placed for step in choice.steps], self.base, simulated=True)
        return self.likelihood(chosen, choice.problem.noise)

    def _joined(self, one: Confined, trial: Choice, facts: Facts) -> tuple[Confined, Choice]:
        """Takes in the judge scenes that are likelier with the effect than without it."""
        law, z = one.step.chosen.effect, one.step.fitted.z
        everywhere = on_top(one.plain, self.base, z)
        better = self.likelihood(everywhere, one.step.fitted.noise) > self.likelihood(self.base, self.base.noise)
        names = {facts.names[k] for k in self.frame[(self.fitted == 0) & better].tolist()}
        region = Region(scenes=tuple(sorted({*one.region.scenes, *names})))
        frames: Bool[np.ndarray, " f"] = np.isin(facts.names, region.scenes)
        wider = within(one.plain, region, frames)
        step = replace(one.step, chosen=replace(one.step.chosen, effect=wider))
        steps = tuple(step if old.chosen.effect is law else old for old in trial.steps)
        return replace(one, step=step, region=region, frames=frames), replace(trial, steps=steps)
