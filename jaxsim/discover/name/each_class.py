"""What surfaces of a class alone say, and all others deny: something of these surfaces, and nothing of the sensor.

A simulated street may have flat soil where the real one undulates, and solid crowns where real ones are of leaves. What
that does to readings can look like an effect of a sensor, as noise that grows while echoes weaken does. But a sensor
does the same to every surface. So without the class that says most for an effect the others may say little of it, and
must not clearly speak against it: neither lose by it, nor gain far less than they would if it were there. Nor may a
class show far less of an effect than it would, where another explains as much and none denies that. And where a
class's surfaces are seen to be others on the two sides, what else they show of ranges and losses must be shown by
others as well; so must glare by other rays than a post can meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.data.cityscapes import NAMES
from jaxsim.discover.model.evidence import Evidence, near_enough
from jaxsim.discover.model.fit import NOTHING, Problem, fit, fit_noise, on_top, score_at, score_columns
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.null_model import reweighted
from jaxsim.discover.model.parameters import host_values
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import FittedStep, fitted_step
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.effects.catalogue.blooming import ON_TARGET_RAD


def denied_without(step: FittedStep, problem: Problem) -> str:
    """The class without whose surfaces all others clearly speak against an effect that was fitted to a problem, by
    name; empty where there is none, and of effects that move or turn rays: these meet other surfaces, of any class.
    Of a lattice, too, which all readings tell beside the likelihood of single rays (`likelihood.rounding_gain`)."""
    effect = step.chosen.effect
    if effect.casts or effect.name in FINEST:
        return ""
    semantic, hit = np.asarray(problem.ev.rays.semantic), np.asarray(problem.ev.rays.hit)
    kinds, counts = np.unique(semantic[hit], return_counts=True)
    shares = counts / max(counts.sum(), 1)
    bends = "intensity" in effect.channels
    twice = once_more(step, problem) if bends else problem.ev
    for kind in kinds[(shares >= RULES.class_least_share) & (shares <= 1 - RULES.class_least_share)]:
        rest = replace(problem, ev=leaving_out(problem.ev, semantic == kind))
        more = replace(problem, ev=leaving_out(twice, semantic == kind))
        if _lose(step, rest) or (bends and _fall_short(step, rest, more)):
            return NAMES[int(kind)]
    return ""


def once_more(step: FittedStep, problem: Problem) -> Evidence:
    """The evidence with what an effect does to intensities added to those that were measured. What it gains there more
    is twice what it gains on average where it is as it was fitted: y -> y·e - e²/2, in units of the noise."""
    placed = on_top(step.chosen.effect, problem, step.fit.z).ev.rays
    change = jnp.asarray(placed.log_intensity) - jnp.asarray(problem.ev.rays.log_intensity)
    return replace(problem.ev, log_intensity=problem.ev.log_intensity + change)


def outdone_in(step: FittedStep, problem: Problem) -> str:
    """The class that shows far less of an effect than it would, by name, of one that goes by how bright surfaces are;
    where another effect explains nearly as much and no class denies that. Else empty."""
    chosen = step.chosen
    rivals = [one for one in step.ranking if one is not chosen and _rivals(one, chosen)]
    # Dark and bright classes show such an effect differently, or it is none; of ranges and angles they tell less.
    if not _of_intensity(chosen) or "intensity" not in chosen.effect.covariates or not rivals:
        return ""
    worst, by = _shortfall(step, problem)
    if by < RULES.outdone_sds:
        return ""
    for rival in rivals:
        instead = fitted_step(problem, rival, ranking=step.ranking, among=[rival])
        if _shortfall(instead, problem)[1] < RULES.due_sds:
            return NAMES[worst]
    return ""


def _of_intensity(one: Candidate) -> bool:
    """Whether an effect changes intensities alone, of the surfaces that are seen without it."""
    return one.effect.channels == ("intensity",) and not one.effect.casts and one.effect.name not in FINEST


def _rivals(one: Candidate, chosen: Candidate) -> bool:
    """Whether a candidate with no more numbers explains nearly as much of the intensities as the chosen one."""
    near = one.total >= RULES.alike_share * chosen.total and one.scenes_agree
    return near and _of_intensity(one) and one.numbers <= chosen.numbers


def _shortfall(step: FittedStep, problem: Problem) -> tuple[int, float]:
    """The class that alone gains least by an intensity effect of what it would if that were there, and by how many
    standard deviations it gains less."""
    semantic, compared = np.asarray(problem.ev.rays.semantic), np.asarray(problem.ev.compared)
    twice = once_more(step, problem)
    worst, most = 0, 0.0
    kinds, counts = np.unique(semantic[compared], return_counts=True)
    for kind in kinds[counts >= RULES.class_least_share * counts.sum()]:
        alone = replace(problem, ev=leaving_out(problem.ev, semantic != kind))
        more = replace(problem, ev=leaving_out(twice, semantic != kind))
        got = float(clipped(gains_as_fitted(step, alone)).sum())
        due = (float(clipped(gains_as_fitted(step, more)).sum()) - got) / 2
        by = (due - got) / np.sqrt(max(2 * due, 1.0))
        if by > most:
            worst, most = int(kind), float(by)
    return worst, most


def _lose(step: FittedStep, rest: Problem) -> bool:
    """Whether scenes agree that a part of the rays loses by an effect."""
    # A look at the fit as it is costs little, and mostly decides.
    if gains_as_fitted(step, rest).sum() >= 0:
        return False
    lost = clipped(-gained(step, rest))
    return bool(lost.sum() > RULES.bar_nats and p_value(lost) <= RULES.denied_level)


def _fall_short(step: FittedStep, rest: Problem, more: Problem) -> bool:
    """Whether a part of the rays gains far less by an effect than it would if that were there; `more` has it once more
    (`once_more`)."""
    for gains in (gains_as_fitted, gained):
        by_scene = gains(step, rest)
        due = float((gains(step, more) - by_scene).sum()) / 2
        got = float(clipped(by_scene).sum())
        # A gain of y·e - e²/2 has a variance of e², twice its mean.
        if due <= 0 or got > RULES.denied_share * due or due - got < RULES.denied_sds * np.sqrt(2 * due):
            return False
    return True


def gains_as_fitted(step: FittedStep, rest: Problem) -> Float[np.ndarray, " s"]:
    """What an effect gains in each scene of a part of the rays, nats, with the noise of all of them."""
    effect, result = step.chosen.effect, step.fit
    with_effect = score_at(effect, rest, z=result.z, noise=result.noise)
    without = score_at(NOTHING, rest, z={}, noise=rest.noise)
    return rest.ev.by_scene((with_effect - without)[:, score_columns(effect)].sum(-1))


def shown_by(step: FittedStep, problem: Problem, classes: Sequence[int]) -> str:
    """Finds classes whose surfaces are partly others on the two sides: their names, where they alone show an effect on
    ranges or losses that was fitted to a problem; empty where others do, or where they are most of what is seen, and of
    a lattice (as in `denied_without`)."""
    effect = step.chosen.effect
    if "intensity" in effect.channels or effect.casts or effect.name in FINEST or not classes:
        return ""
    semantic, hit = np.asarray(problem.ev.rays.semantic), np.asarray(problem.ev.rays.hit)
    of_these = np.isin(semantic, classes)
    if of_these[hit].mean() > RULES.apart_most_share:
        return ""
    by_others = clipped(gained(step, replace(problem, ev=leaving_out(problem.ev, of_these)))).sum()
    return "" if by_others > RULES.bar_nats else ", ".join(NAMES[one] for one in classes)


def shown_below(step: FittedStep, problem: Problem) -> bool:
    """Whether none but the rays straight below very bright targets show glare that was fitted to a problem. A sign's
    post stands there, which single rays of one side meet and those of the other pass; glare has no side."""
    if not step.chosen.effect.around_bright:
        return False
    out = straight_below(problem.ev)
    return bool(clipped(gained(step, replace(problem, ev=leaving_out(problem.ev, out)))).sum() <= RULES.bar_nats)


def straight_below(ev: Evidence) -> Bool[np.ndarray, "b c r"]:
    """The rays of a column below one that meets the very bright target nearest to them."""
    elevation = np.asarray(ev.rays.elevation_rad)
    # A ray that meets such a target is at no angle to the nearest one.
    on_target = np.asarray(ev.rays.hit) & (np.asarray(ev.rays.glare_rad) < ON_TARGET_RAD)
    # Each ray against each of its column: the last axis is that of the others.
    ours_m, others_m = np.broadcast_arrays(np.asarray(ev.rays.glare_m)[..., None], ev.rays.range_m[..., None, :])
    of_target = on_target[..., None, :] & np.asarray(near_enough(others_m, ours_m))
    return np.any(of_target & (elevation[..., None, :] > elevation[..., None]), axis=-1)


def gained(step: FittedStep, rest: Problem) -> Float[np.ndarray, " s"]:
    """What an effect gains in each scene of a part of the rays to all of which it was fitted, nats."""
    effect = step.chosen.effect
    # Noise that was fitted to all surfaces may be too much or too little for these: it is fitted to them.
    rest = reweighted(rest, rest.ev.all_blocks)
    placed = fit(effect, rest, starts=(host_values(effect, step.fit.z),), fixed=True)
    return rest.ev.by_scene((placed.score - fit_noise(rest).score)[:, score_columns(effect)].sum(-1))


def leaving_out(ev: Evidence, out: Bool[np.ndarray, "b c r"]) -> Evidence:
    """The evidence without rays: they hit nothing and return nothing."""
    kept = jnp.asarray(~out)
    return replace(
        ev,
        rays=replace(ev.rays, hit=ev.rays.hit & kept),
        returned=ev.returned & kept,
        compared=ev.compared & kept,
        features=jnp.where(kept[..., None], ev.features, 0),
    )
