"""The whole catalogue, each effect fitted and judged on scenes that its fit has not seen.

Effects with a number for each beam are held against the same with these numbers made smooth along the rows. A laser's
gain, bias or elevation is its own affair: neighbours in the table need not agree. What the rows see (road below, walls
and windows above) changes smoothly from row to row, and a simulator's wrong materials look like smooth gains.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.model.fit import Fit, Problem, best_starts, fit, partway, score_at, score_columns
from jaxsim.discover.model.likelihood import rounded, rounding_gain
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.parameters import fitted_parameters, to_values
from jaxsim.discover.name.starts import starts_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, folds, p_value
from jaxsim.effects import Law
from jaxsim.metrics.intervals import mean_interval
from jaxsim.progress import Progress

THREADS = 2
"""Effects fitted side by side."""


@dataclass(frozen=True)
class Candidate:
    """An effect and what it gained on held-out scenes."""

    effect: Law
    gain: Float[np.ndarray, "s 3"]
    """Log-likelihood over the null, nats, by scene and channel."""
    fits: tuple[Fit, ...]
    """One a fold."""
    slope: Float[np.ndarray, " s"]
    """Gain by scene of the first `Rules.direction_share` of the way to each fit: what scenes say of its direction."""
    over_smooth: Float[np.ndarray, " s"] | None = None
    """Of an effect with a number for each beam: gain by scene over the same effect with these numbers made smooth along
    the rows. What is smooth may be what the rows see, not what the beams do."""
    over_smooth_slope: Float[np.ndarray, " s"] | None = None
    """The same of the first part of the way, as `slope` is of the gain."""
    inside: float = 0.0
    """Log-likelihood over the null on the very scenes that were fitted, nats, mean of the folds: no evidence, but what
    a choice without held-out scenes would go by."""

    @property
    def by_scene(self) -> Float[np.ndarray, " s"]:
        """Gain by scene, all channels."""
        return self.gain.sum(-1)

    @property
    def total(self) -> float:
        """Gain of all scenes, none of which decides alone."""
        return float(clipped(self.by_scene).sum())

    @property
    def chance(self) -> float:
        """Probability that scenes agree so well by chance, on the fit or on its direction (the better of two tests)."""
        # Bonferroni's correction pays for having taken the better of two tests.
        return min(1.0, 2 * min(p_value(clipped(self.by_scene)), p_value(clipped(self.slope))))

    @property
    def sudden(self) -> bool:
        """Whether few scenes gain so much, and the others lose so little, that no test over scenes is needed: of a
        rare event (lost packets) most scenes say nothing."""
        gain = self.by_scene
        enough = (gain > RULES.sudden_nats).sum() >= RULES.decisive_scenes
        lost = -gain[gain < 0].sum()
        return bool(enough and lost < RULES.sudden_loss * gain[gain > 0].sum())

    @property
    def scenes_agree(self) -> bool:
        """Whether the scenes agree on its gain: on its direction at least, with an interval of the gain above 0."""
        return self.sudden or (self.chance <= RULES.agreement_level and mean_interval(clipped(self.by_scene))[0] > 0)

    @property
    def rough_nats(self) -> float:
        """What numbers of single beams gain over the same made smooth along the rows; infinite where there are none."""
        return float("inf") if self.over_smooth is None else float(clipped(self.over_smooth).sum())

    @property
    def smooth_is_enough(self) -> bool:
        """Whether an effect of single beams gains no more, for certain, than a smooth change along the rows."""
        if self.over_smooth is None:
            return False
        p = p_value(clipped(self.over_smooth))
        if self.over_smooth_slope is not None:
            # As of the gain itself: scenes may agree that single beams are off, and not on how much each is.
            p = 2 * min(p, p_value(clipped(self.over_smooth_slope)))
        return bool(self.rough_nats <= RULES.bar_nats or p > RULES.agreement_level)

    def accepted(self, bar: float = RULES.bar_nats) -> bool:
        """Whether it passes the bar, and the scenes agree that it should; of an effect of single beams, also on what
        its beams' numbers gain over a smooth change along the rows."""
        return not self.smooth_is_enough and self.total > bar and self.scenes_agree

    @property
    def fitted_values(self) -> tuple[dict[str, Any], ...]:
        """Its parameters as each fold's fit has them: where fits to all scenes begin, which need not search anew."""
        return tuple(to_values(self.effect, of_fold.z) for of_fold in self.fits)

    @property
    def size(self) -> float:
        """How large it is: the largest of its numbers, in the mean of the folds, from where it does nothing, in what is
        clearly visible (`Parameter.scale`)."""
        means = [np.mean([of_fold.z[name] for of_fold in self.fits], axis=0) for name in self.fits[0].z]
        return max((float(np.abs(mean).max()) for mean in means), default=0.0)

    @property
    def numbers(self) -> int:
        """How many numbers its fit chose."""
        return sum(np.size(value) for value in self.fits[0].z.values())


def rank_effects(
    problem: Problem, effects: Iterable[Law], *, null_fits: Sequence[Fit] | None = None, bar: float = -np.inf
) -> list[Candidate]:
    """Every effect fitted on each fold's scenes and scored on the others; largest gain first.

    `null_fits` saves these fits where they are known. Where only what passes a `bar` is asked for, an effect whose
    first fit leaves no hope of it is not fitted on the other folds.
    """
    trial = _Trial.of(problem, null_fits or problem.null_fits, bar=bar)
    with ThreadPoolExecutor(THREADS) as pool:
        # Effects that round are tried where a lattice was read off the data, and nowhere else.
        tried = [e for e in effects if e.name not in FINEST or e.name in trial.steps]
        shown = {"total": len(tried), "desc": "fitting", "unit": "effect", "leave": False}
        ranking = list(Progress(pool.map(trial.candidate, tried), **shown))
    return sorted(ranking, key=lambda candidate: -candidate.total)


@dataclass(frozen=True)
class _FoldGain:
    """What the fit of one fold gains in each scene of the problem, nats; 0 in those that it was fitted to."""

    result: Fit
    gain: Float[np.ndarray, "s 3"]
    slope: Float[np.ndarray, " s"]
    """What `Candidate.slope` holds; so with `inside`."""
    over_smooth: Float[np.ndarray, "2 s"] | None
    """`over_smooth` and `over_smooth_slope` of `Candidate`."""
    inside: float


@dataclass(frozen=True)
class _Trial:
    """What every effect is tried on: folds of the scenes, and the null's fit to each, which it has to beat."""

    problem: Problem
    scene: Int[np.ndarray, " b"]
    masks: Float[np.ndarray, "k b"]
    """For each fold, 1 for the blocks that are fitted and 0 for those held out."""
    null_fits: Sequence[Fit]
    steps: dict[str, float]
    """Steps of the lattices on which readings lie, by the effect that rounds."""
    starts: dict[str, tuple[dict[str, Any], ...]]
    """The starts that are read off the data, by effect."""
    bar: float

    @classmethod
    def of(cls, problem: Problem, null_fits: Sequence[Fit], *, bar: float) -> _Trial:
        scene = np.asarray(problem.ev.scene)
        return cls(problem, scene, folds(scene), null_fits, rounded(problem.ev), starts_of(problem), bar)

    def candidate(self, effect: Law) -> Candidate:
        """An effect fitted on each fold; on the first alone where that leaves no hope."""
        # Of starts that say the same the first is taken: those that are read off all columns know more than the fit.
        starts = ({}, *self.starts.get(effect.name, ()), *effect.starts)
        if effect.name in self.steps:
            starts = ({next(iter(effect.parameters)): self.steps[effect.name]},)
        by_fold: list[_FoldGain] = []
        for fold, start in enumerate(best_starts(effect, self.problem, starts, parts=self.masks)):
            by_fold.append(self.fold_gain(effect, fold, start=start))
            if self.hopeless(by_fold[0]):
                break
        # Each scene counts by the one fit that has not seen it; numbers of scenes may have gaps.
        seen = np.unique(self.scene)
        over_smooth = [one.over_smooth for one in by_fold if one.over_smooth is not None]
        return Candidate(
            effect,
            np.sum([one.gain for one in by_fold], axis=0)[seen],
            tuple(one.result for one in by_fold),
            np.sum([one.slope for one in by_fold], axis=0)[seen],
            *(np.sum(over_smooth, axis=0)[:, seen] if over_smooth else (None, None)),
            inside=float(np.mean([one.inside for one in by_fold])),
        )

    def hopeless(self, first: _FoldGain) -> bool:
        """Whether an effect whose first fold gains so much will not pass the bar."""
        within_bar = first.gain.sum(-1).clip(0).sum() < self.bar
        return bool(first.inside < RULES.hopeless_share * self.bar and within_bar)

    def fold_gain(self, effect: Law, fold: int, *, start: dict[str, Any]) -> _FoldGain:
        """An effect fitted to one fold's scenes from a start, and what it gains."""
        in_fit, base = self.masks[fold], self.null_fits[fold]
        # Candidate and null begin at the same noise, so that what one gains is the effect's.
        problem = replace(self.problem, noise=base.noise)
        used = score_columns(effect)
        step = self.steps.get(effect.name)
        # A lattice's step is read off the readings; its fit moves the noise alone, and has no direction.
        result = fit(effect, problem, in_fit, starts=(start,), fixed=step is not None)
        gain = _in_columns(result.score - base.score, used)
        if step is not None:
            gain += rounding_gain(problem.ev, {effect.name: step})
            on_the_way, over_smooth = gain, None
        else:
            part = partway(effect, problem, in_fit, fit=result, share=RULES.direction_share)
            on_the_way = _in_columns(part - base.score, used)
            over_smooth = self.over_smooth(effect, problem, in_fit, result=result, part=part)
        return _FoldGain(
            result,
            np.stack([self.by_scene(gain[:, k], in_fit) for k in range(3)], axis=-1),
            self.by_scene(on_the_way.sum(-1), in_fit),
            over_smooth,
            gain[in_fit > 0].sum(),
        )

    def over_smooth(
        self, effect: Law, problem: Problem, in_fit: Float[np.ndarray, " b"], *, result: Fit, part: np.ndarray
    ) -> Float[np.ndarray, "2 s"] | None:
        """What a fit, and `part` of the way to it, gain over the fit with its beams' numbers made smooth; None of an
        effect without such."""
        if not by_beam(effect):
            return None
        smooth_fit = smoothed(effect, problem, in_fit, result=result)
        smooth_part = partway(effect, problem, in_fit, fit=smooth_fit, share=RULES.direction_share)
        used = score_columns(effect)
        rough = (result.score - smooth_fit.score, part - smooth_part)
        return np.stack([self.by_scene(one[:, used].sum(-1), in_fit) for one in rough])

    def by_scene(self, of_blocks: Float[np.ndarray, " b"], in_fit: Float[np.ndarray, " b"]) -> Float[np.ndarray, " s"]:
        """Sums over the blocks of each scene that are held out."""
        return np.bincount(self.scene, np.where(in_fit > 0, 0, of_blocks), self.problem.ev.scenes)


def _in_columns(score: Float[np.ndarray, "b 3"], used: list[int]) -> Float[np.ndarray, "b 3"]:
    """A score with 0 in the columns that are not used."""
    result = np.zeros(score.shape)
    result[:, used] = score[:, used]
    return result


def by_beam(effect: Law) -> bool:
    """Whether the effect has a number for each beam."""
    return any(p.shape == "row" for p in fitted_parameters(effect).values())


def smooth(numbers: Float[np.ndarray, " r"]) -> Float[np.ndarray, " r"]:
    """Each number replaced by the line through it and its neighbours, `Rules.beam_rows` to each side, by least
    squares."""
    rows = np.arange(len(numbers))
    result = np.empty(len(numbers))
    for k in rows:
        near = slice(max(k - RULES.beam_rows, 0), k + RULES.beam_rows + 1)
        away = rows[near] - k
        # A line, not a mean: at the table's ends a mean would lag behind a slope.
        result[k] = np.polyfit(away, numbers[near], min(1, len(away) - 1))[-1]
    return result


def smoothed(effect: Law, problem: Problem, in_fit: Float[np.ndarray, " b"], *, result: Fit) -> Fit:
    """A fit with the beams' numbers made smooth, and what it scores."""
    kinds = fitted_parameters(effect)
    z = {name: smooth(value) if kinds[name].shape == "row" else value for name, value in result.z.items()}
    z = {name: np.asarray(value, np.float32) for name, value in z.items()}
    return replace(result, z=z, score=score_at(effect, problem, in_fit, z=z, noise=result.noise))
