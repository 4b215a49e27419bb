"""Show: what judge scenes say of the effects that were added, for nothing was fitted to them; an answer is one only if
they gain by it.

    gap              how far simulation and measurement are apart, before and after
    pictures         what a report draws of judge scenes
    every_frame      the same of all frames that were not read, block by block
    sensitivity      what the frames could show of each effect
    explain          an answer's entries and notes in words
    few_drives       what frames of few drives show of effects that are bound to directions
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.devices import by_small_steps, side_by_side
from jaxsim.discover.add import Added
from jaxsim.discover.find.covariates import COVARIATES
from jaxsim.discover.find.division import AllScenes, Division, NullModel
from jaxsim.discover.model.fit import (
    ANSWER_STEPS,
    NOTHING,
    Chain,
    Problem,
    by_reported,
    coupled,
    fit,
    in_place,
    score_at,
    score_columns,
)
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.null_model import fit_null, refit, refitted, reweighted
from jaxsim.discover.model.parameters import host_values, to_z
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import Choice, runner_up
from jaxsim.discover.read import Comparison
from jaxsim.discover.rules import RULES
from jaxsim.discover.show.gap import Distance, additive_floor, closure, distance, gaps
from jaxsim.discover.show.pictures import joined, rays_of, residual_curves, residual_maps, whole_frames
from jaxsim.discover.verdict import CurveLine, Gap, Interval, Judged, JudgeFrame, Named, Verdict
from jaxsim.effects import Law, get_effect
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.effect import CHANNELS

WHY_NOT = "scenes that it was not fitted to do not gain by it"


def show_gap(null_model: NullModel, choice: Choice, added: Added) -> Judged:
    """The gap before and after the effects were added, beside a placebo: the runner-up, added in their place."""
    rival = runner_up(choice.steps)
    placebo = placebo_of(null_model.problem, rival) if rival else None
    return gap_with(null_model, added.chain, choice.problem.noise, placebo=placebo)


def gap_with(
    null_model: NullModel, chain: Chain, noise: Noise, *, placebo: tuple[Chain, Noise] | None = None
) -> Judged:
    """The gap with the effects of `chain` in place, which leave `noise`; `placebo` is another chain with its own noise.
    Nuisances that scenes share come from the find scenes."""
    every = AllScenes.of(null_model)
    in_fit, scene = every.in_fit, every.scene
    # Effects leave less noise than the null has: each side is judged with its own.
    before = every.problem_with()
    after = every.problem_with(chain, noise)
    curves = residual_curves(before, after, in_fit=in_fit, scene=scene, effects=[effect for effect, _ in chain])

    def away(problem: Problem) -> Distance:
        return distance(problem, in_fit, before.equations, scene=scene)

    def numbers() -> tuple[dict[str, Gap], Interval | None]:
        was, now = away(before), away(after)
        instead = away(every.problem_with(*placebo)) if placebo else was
        floor = away(_with_floor(every, before, [effect for effect, _ in chain]))
        shown = gaps(was, now, placebo=instead, floor=floor)
        return shown, closure(was, now, floor=floor, channels={name for effect, _ in chain for name in effect.channels})

    (gap, closed), frames = side_by_side(numbers, partial(_frames, null_model, chain, noise, curves=curves))
    maps = residual_maps(before, in_fit=in_fit), residual_maps(after, in_fit=in_fit)
    return Judged(gap, closed, *maps, curves, frames)


def judged_by_reported(null_model: NullModel, added: Added) -> dict[str, float]:
    """What judge scenes gain by each named effect that follows the intensity which was reported, with all others in
    place and the parameters that were fitted: nats a scene. The gap is that of simulations, which know the simulated
    intensity."""
    held = [one for one in added.refits if by_reported(one.effect)]
    if not held:
        return {}
    every = AllScenes.of(null_model)
    judged = every.in_fit == 0
    gained = {}
    for one in held:
        others = [(other.effect, other.fit.z) for other in added.refits if other is not one]
        null = refitted(in_place(null_model.problem, others))
        before = every.problem_with(others, null.noise)
        without = score_at(NOTHING, before, every.in_fit, z={}, noise=null.noise)
        # The parameters stay as they are: only the noise is fitted, as it is without the effect.
        beside = fit(one.effect, null, starts=(host_values(one.effect, one.fit.z),), fixed=True)
        after = score_at(one.effect, before, every.in_fit, z=beside.z, noise=beside.noise)
        by_block = (after - without)[judged][:, score_columns(one.effect)].sum(-1)
        gained[one.effect.plain_name] = float(by_block.sum() / len(np.unique(every.scene[judged])))
    return gained


def _with_floor(every: AllScenes, before: Problem, effects: Sequence[Law]) -> Problem:
    """What is left `before` with free curves of what the effects may depend on, learned on the find scenes; the noise
    that they leave there is fitted beside them."""
    null_model = every.null_model
    covariates = {name for effect in effects for name in effect.covariates} or set(COVARIATES)
    curves = additive_floor(before, every.in_fit, sorted(covariates))
    # The null's evidence is that of the find scenes.
    seen = curves.on(null_model.problem.ev, every.in_fit > 0)
    curved = fit_null(null_model.division.scan, seen, clutter=null_model.problem.clutter)
    return reweighted(replace(before, ev=curves.on(every.ev), noise=curved.noise), every.in_fit)


def law_gains(null_model: NullModel, added: Added, *, before: Problem, effects: Chain) -> bool:
    """Whether judge scenes gain, in its channel and in the mean, by the law that was learned (`Rules.confirmed_nats`).
    `effects` are those that were in place before it, in `before`; all of `added` with the law."""
    if added.learned is None:
        return False
    every = AllScenes.of(null_model)
    gained = judge_gains(every, added.chain) - judge_gains(every, effects, before.noise)
    return bool(gained[CHANNELS.index(added.learned.learned.channel)] > RULES.confirmed_nats)


def judge_gains(every: AllScenes, chain: Chain, noise: Noise | None = None) -> Float[np.ndarray, " 3"]:
    """Nats that a judge scene gains in each channel, in the mean, by effects and the `noise` that they leave (by
    default as it is fitted to the find scenes)."""
    noise = refitted(in_place(every.null_model.problem, chain)).noise if noise is None else noise
    before, after = every.problem_with(), every.problem_with(chain, noise)
    sides = [distance(problem, every.in_fit, before.equations, scene=every.scene) for problem in (before, after)]
    return (sides[1].log_likelihood - sides[0].log_likelihood).mean(0)


def _frames(
    null_model: NullModel, chain: Chain, noise: Noise, *, curves: tuple[CurveLine, ...]
) -> tuple[JudgeFrame, ...]:
    """A few judge frames with nearly all their rays, before the effects and with them."""
    parts: dict[str, list[JudgeFrame]] = {}
    for chunk in whole_frames(null_model.division):
        every = AllScenes.of(null_model, chunk.division)
        before = every.problem_with()
        after = every.problem_with(chain, noise)
        for part in rays_of(before, after, in_fit=every.in_fit, chunk=chunk, curves=curves):
            parts.setdefault(part.name, []).append(part)
    return tuple(map(joined, parts.values()))


def placebo_of(null: Problem, rival: Candidate) -> tuple[Chain, Noise]:
    """The runner-up fitted as the answer is: to all find scenes, from the best of its folds' fits; and the noise that
    it leaves."""
    effect = rival.effect
    # As many steps as the answer's own fits have: a placebo that lagged behind would make it look better.
    fixed = effect.name in FINEST
    result = fit(effect, null, starts=rival.fitted_values, steps=ANSWER_STEPS, fixed=fixed)
    chain = [(effect, result.z)]
    return chain, refitted(in_place(null, chain)).noise


@by_small_steps
def judge_known(
    comparison: Comparison, answer: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, Gap], Interval | None]:
    """The gap on judge scenes, and its closure, that an answer known in advance reaches.

    `answer` has the effects and the parameters that their fits begin at. What `discover` finds can be held against it;
    nothing is named, and there is no placebo.

    Raises ValueError for unknown effects and where the scenes are too few.
    """
    effects = [get_effect(name) for name in answer]
    null_model = NullModel.of(Division.of(comparison))
    rows = null_model.problem.ev.rays.row.shape[-1]
    starts = [to_z(effect, dict(answer[effect.name]), rows) for effect in effects]
    chain = [(one.effect, one.fit.z) for one in refit(null_model.problem, effects, starts)]
    shown = gap_with(null_model, chain, refitted(in_place(null_model.problem, chain)).noise)
    return shown.gap, shown.closure


def without_unconfirmed(verdict: Verdict, apart: Mapping[str, float] | None = None) -> Verdict:
    """The verdict without the effects by which its judge scenes do not gain, or next to nothing of what scenes gained
    on which they were found: these are kept as `unconfirmed`. The gap still shows what all of them do. `apart` is what
    these scenes gain by effects that the gap cannot judge (`judged_by_reported`), by name.

    The mean decides, not its interval: judge scenes are few, and right effects may be rare or weak
    (`Rules.confirmed_nats`, `Rules.confirmed_share`).
    """
    apart = apart or {}
    gained = [apart.get(one.name, verdict.judged_nats(*coupled(one.channels))) for one in verdict.effects]
    lost = tuple(
        one
        for one, nats in zip(verdict.effects, gained, strict=True)
        if nats <= max(RULES.confirmed_nats, RULES.confirmed_share * one.gain.value)
    )
    if not lost:
        return verdict
    confirmed_effects = tuple(effect for effect in verdict.effects if effect not in lost)
    names = [effect.name for effect in lost]
    note = (
        f"not confirmed on unseen scenes: {', '.join(names)} explained the scenes that the search saw, but the "
        f"{len(verdict.judge)} judge scenes gain less than {100 * RULES.confirmed_share:.0f} % of that in the mean; it "
        "is not named. The gap is shown with it in place"
    )
    answer = verdict.verdict
    if answer == "named" and not confirmed_effects:
        # What is not confirmed leaves a disagreement: it is named as such where a curve showed one.
        answer = "not_in_catalogue" if verdict.unexplained else "none"
    return replace(
        verdict,
        verdict=answer,
        effects=confirmed_effects,
        unconfirmed=lost,
        regimes=tuple(regime for regime in verdict.regimes if regime.effect not in names),
        ranking=tuple(replace(rank, why_not=WHY_NOT) if rank.name in names else rank for rank in verdict.ranking),
        notes=(*verdict.notes, note),
    )


def with_placed(verdict: Verdict, sure: tuple[Named, ...], others: tuple[Named, ...] = (), *, how: str) -> Verdict:
    """The verdict with effects that were put in place first before what was named with them there, and a note on `how`
    they were found; `others` were found and not confirmed."""
    if not sure and not others:
        return verdict
    names = ", ".join(effect.name for effect in (*sure, *others))
    return replace(
        verdict,
        # What was put in place is an answer, too.
        verdict="named" if sure and verdict.verdict == "none" else verdict.verdict,
        effects=(*sure, *verdict.effects),
        unconfirmed=(*others, *verdict.unconfirmed),
        notes=(*verdict.notes, f"{names}: {how}"),
    )


def effects_model_of(verdict: Verdict, added: SensorModel, known: SensorModel) -> SensorModel:
    """What the sensor model holds after the verdict: what was `known`, the effects that it names of a mounting, and
    what was `added`, but for effects that are not confirmed."""
    named = {name for name, _ in known.effects}
    added_names = {name for name, _ in added.effects}
    lost = {effect.name for effect in verdict.unconfirmed} - named
    mounting = [(effect.name, effect.values) for effect in verdict.effects if effect.name not in added_names | named]
    # A mounting that was known stands in the frames, and not in what was added.
    stated = [pair for pair in known.effects if pair[0] not in added_names]
    effects = (*stated, *mounting, *(pair for pair in added.effects if pair[0] not in lost))
    if effects == added.effects:
        return added
    regions = {name: region for name, region in added.regions.items() if name not in lost}
    # A mounting of a part of the recording stands in those frames.
    regions |= {one.effect: one.where for one in verdict.regimes if one.effect in dict(mounting)}
    return replace(added, effects=effects, regions=regions)
