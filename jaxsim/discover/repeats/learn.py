"""Learn: heights of the patterns that repeat, fitted together to the find scenes, in the mixed model of the maps.

A pattern that is not yet in place makes residuals, and so the noise, larger and weights smaller where it is high: what
is read off them is too small. So heights are fitted, put in place with the noise fitted again, and fitted once more
about that (Gauss-Newton); sizes are read off the second time.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.covariates import COVARIATES
from jaxsim.discover.repeats.find import common_size, height_of, told
from jaxsim.discover.repeats.forms import Heights, RepeatForm
from jaxsim.discover.repeats.maps import Maps, Pattern, Sums
from jaxsim.discover.verdict import Interval, Repeat
from jaxsim.effects import Law
from jaxsim.effects.learned import Learned

STEPS = 8
"""Steps of conjugate gradients, at most: levels take up about the same share of all heights, so that few are enough."""
CLOSE = 1e-3
"""Share of the way that may be left, in the norm of the guess."""
ROUNDS = 3
"""Rounds of heights, each about the ones before: of a gain of +-20 % the second comes within 4 %."""
Finding = Bool[np.ndarray, " n"]


@dataclass(frozen=True)
class LearnedRepeat:
    """A pattern, fitted."""

    repeat: Repeat
    """The pattern with the size that was fitted."""
    learned: Learned
    judged_nats: float
    """What judge scenes gain by it."""
    scenes: int
    """Number of scenes that it was fitted to."""
    grid: tuple[int, int]
    """Rows and columns."""


def learn_repeats(
    forms: Sequence[RepeatForm], finding: Finding, maps_with: Callable[[Sequence[Learned]], Mapping[str, Maps]]
) -> tuple[LearnedRepeat, ...]:
    """Fits the forms together. `maps_with` gives the maps that are left with laws in place, their noise fitted again;
    levels that scenes share follow from the scenes where `finding`."""
    result: dict[int, LearnedRepeat] = {}
    heights = {k: np.zeros(form.count) for k, form in enumerate(forms)}
    laws: list[Learned] = []
    for _ in range(ROUNDS):
        remaining = maps_with(laws)
        for channel in dict.fromkeys(form.found.repeat.channel for form in forms):
            of = {k: form for k, form in enumerate(forms) if form.found.repeat.channel == channel}
            # The patterns are back in the residuals, as the model has them about what was fitted before.
            maps = remaining[channel]
            before = {k: maps.centred(maps.response(form.spread(heights[k]))) for k, form in of.items()}
            whole = replace(maps, total=maps.centred(maps.total) + sum(before.values()))
            heights |= dict(zip(of, solve(whole, list(of.values()), finding), strict=True))
            now = {k: maps.centred(maps.response(form.spread(heights[k]))) for k, form in of.items()}
            rest = whole.total - sum(now.values())
            for k, form in of.items():
                # Each pattern alone, with the others taken out: its size is told beside them.
                alone = replace(whole, total=rest + now[k])
                result[k] = _learned(form, heights[k], maps=alone, rest=rest, answer=now[k], finding=finding)
        laws = [result[k].learned for k in range(len(forms))]
    return tuple(result[k] for k in range(len(forms)))


def solve(maps: Maps, forms: Sequence[RepeatForm], finding: Finding) -> list[Heights]:
    """The heights of all forms that fit the find scenes best."""
    cuts = np.cumsum([form.count for form in forms])[:-1]
    stiff = np.concatenate([np.full(form.count, 1 / form.variance) for form in forms])

    def gathered(total: Sums) -> Heights:
        return np.concatenate([form.gather(total[finding]).sum(0) for form in forms])

    def normal(heights: Heights) -> Heights:
        parts = np.split(heights, cuts)
        pattern = np.sum([form.spread(part) for form, part in zip(forms, parts, strict=True)], axis=0)
        return gathered(maps.centred(maps.response(pattern))) + stiff * heights

    weight = maps.weight[finding].sum(0)
    steep = np.concatenate([form.information(weight) for form in forms]) + stiff
    # Heights of places that no scene shows stay 0.
    inverse = np.where(steep > 0, 1 / np.maximum(steep, 1e-12), 0)
    return np.split(conjugate_gradients(normal, gathered(maps.total), inverse), cuts)


def conjugate_gradients(normal: Callable[[Heights], Heights], right: Heights, inverse: Heights) -> Heights:
    """x of normal(x) = right, with `inverse` as a guess of what undoes `normal`, number by number (Hestenes & Stiefel
    1952)."""
    x = np.zeros_like(right)
    residual = right.copy()
    direction = inverse * residual
    size = first = float(residual @ direction)
    for _ in range(STEPS):
        if size <= CLOSE**2 * first:
            break
        # `normal` is dear, a map of every ray: few steps, each along a direction that no later one undoes.
        bent = normal(direction)
        step = size / float(direction @ bent)
        x = x + step * direction
        residual = residual - step * bent
        before, size = size, float(residual @ (inverse * residual))
        direction = inverse * residual + size / before * direction
    return x


def _learned(
    form: RepeatForm, heights: Heights, *, maps: Maps, rest: Sums, answer: Sums, finding: Finding
) -> LearnedRepeat:
    """The law of fitted heights, their standard deviations and the pattern's size. `maps` show the pattern and what
    remains, `rest` the latter alone, `answer` the former."""
    pattern = form.spread(heights)
    steep = form.information(maps.weight[finding].sum(0))
    # Levels take up the rest of what the weights would say.
    share = (answer[finding] * pattern).sum() / max((maps.weight[finding] * pattern**2).sum(), 1e-12)
    curvature = np.maximum(np.clip(share, 1e-3, 1) * steep + 1 / form.variance, 1e-12)
    # Scenes' scatter about the fit (White 1982), as wide at least as the weights say.
    scatter = (form.gather(rest[finding]) ** 2).sum(0)
    sd = np.where(steep > 0, np.sqrt(np.maximum(scatter, share * steep)) / curvature, 0)
    learned = form.learned(heights, sd)
    told_as = form.found.repeat
    size, phase = _size(form, heights, maps=maps)
    repeat = told(
        told_as.channel,
        form.found.scale,
        form.found.number,
        phase=phase,
        size=size,
        p=told_as.p_value,
        p_judge=told_as.p_judge,
    )
    # From no pattern to its maximum a parabola gains its slope less half of what bends it.
    shows = (maps.total * pattern).sum((1, 2)) - (answer * pattern).sum((1, 2)) / 2
    nats = float(shows[~finding].sum())
    return LearnedRepeat(repeat, learned, nats, int(finding.sum()), (pattern.shape[0], pattern.shape[1]))


def _size(form: RepeatForm, heights: Heights, *, maps: Maps) -> tuple[Interval, complex]:
    """The size that all scenes show, and the phase of a wave."""
    channel, scale = form.found.repeat.channel, form.found.scale
    if scale.pattern is None:
        return common_size(maps, scale, channel), 1.0
    phase = complex(heights[0], -heights[1]) if scale.turns else 1.0
    pattern: Pattern = scale.pattern(form.found.number, phase)
    response = maps.centred(maps.response(pattern))
    shows: Float[np.ndarray, " n"] = (maps.total * pattern).sum((1, 2))
    return height_of(shows, (response * pattern).sum((1, 2)), channel), phase


def as_law(learned: Learned) -> Law:
    """A learned law as one without parameters, to be put in place."""
    mark = hashlib.sha256(repr(learned).encode()).hexdigest()[:12]
    along = [{"column": "azimuth"}.get(name, name) for name in learned.covariates]
    return Law(
        name=f"{learned.name} ({mark})",
        parameters={},
        channels=(learned.channel,),
        apply=lambda p, rays: learned.apply(rays),
        covariates=tuple(name for name in along if name in COVARIATES),
    )
