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

from jaxsim.discover.find.covariates import COVARIATES
from jaxsim.discover.repeats.find import FoundPattern, common_size, height_of
from jaxsim.discover.repeats.maps import Maps, MapSums, PatternMap
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Interval, Repeat
from jaxsim.effects import Law
from jaxsim.effects.learned import LIMITS, Learned

_Heights = Float[np.ndarray, " m"]
CONJUGATE_STEPS = 8
"""Steps of conjugate gradients, at most: levels take up about the same share of all heights, so that few are enough."""
CLOSE = 1e-3
"""Share of the way that may be left, in the norm of the guess."""
HEIGHT_ROUNDS = 3
"""Rounds of heights, each about the ones before: of a gain of +-20 % the second comes within 4 %."""
Finding = Bool[np.ndarray, " n"]


@dataclass(frozen=True)
class RepeatForm:
    """A pattern before its m heights are fitted."""

    origin: FoundPattern
    count: int
    """How many heights there are."""
    spread: Callable[[_Heights], PatternMap]
    """The pattern of so many heights."""
    gather: Callable[[MapSums], Float[np.ndarray, "n m"]]
    """The transpose of `spread`, scene by scene: how much the heights have to do with each scene's cells."""
    information: Callable[[PatternMap], _Heights]
    """Information on each height alone, of these weights of the cells."""
    variance: float
    """Variance of the heights, where they are many and share one: how large the pattern is. Infinite where each is its
    own."""
    usual_loss: float
    """Share of the rays that is lost everywhere."""

    def in_place(self, heights: _Heights) -> PatternMap:
        """What the law of fitted heights changes, within what a law may."""
        if self.origin.scale.turns:
            return self.spread(self._swings(heights))
        return _allowed(self.spread(heights), self.origin.repeat.channel, usual_loss=self.usual_loss)

    def _swings(self, heights: _Heights) -> _Heights:
        """Heights of a wave. One of drops swings about a level of its own height: both together stay a probability."""
        channel = self.origin.repeat.channel
        limit = LIMITS[channel][1] / (2 if channel == "drop" else 1)
        return np.clip(heights, -limit, limit)

    def learned(self, heights: _Heights, sd: _Heights) -> Learned:
        """The law of fitted heights."""
        channel, scale = self.origin.repeat.channel, self.origin.scale
        if scale.turns:
            turns = scale.turns(self.origin.number)
            used = [(name, (turn,)) for name, turn in zip(("row", "column"), turns, strict=True) if turn]
            names, knots = zip(*used, strict=True)
            return Learned(channel, "wave", names, knots, _plain(self._swings(heights)), _plain(sd))
        if scale.name == "parity":
            names = tuple(f"even {name}s" for name in ("row", "column") if name in scale.along)
            # Two rows and two columns hold all of a parity.
            corner = self.in_place(heights)[:2, :2]
            spread = self.spread(sd)[:2, :2]
            cut = np.ix_(*([0, 1] if name in scale.along else [0] for name in ("row", "column")))
            knots = ((0.0, 1.0),) * len(names)
            return Learned(channel, "table", names, knots, _plain(corner[cut]), _plain(np.abs(spread[cut])))
        return _table(self.in_place(heights), self.spread(sd), along=scale.along, channel=channel)


def pattern_form(origin: FoundPattern, rows: int, columns: int, *, usual_loss: float) -> RepeatForm:
    """The form of a pattern on a grid of so many rows and columns, of rays of which a share is lost everywhere."""
    scale, k = origin.scale, origin.number
    if scale.pattern is None:
        shape = [count if name in scale.along else 1 for name, count in (("row", rows), ("column", columns))]
        alone = tuple(axis + 1 for axis, count in enumerate(shape) if count == 1)

        def gather(total: MapSums) -> Float[np.ndarray, "n m"]:
            return total.sum(alone, keepdims=True).reshape(len(total), -1)

        def spread(heights: _Heights) -> PatternMap:
            return np.broadcast_to(heights.reshape(shape), (rows, columns))

        size = origin.repeat.size.value
        return RepeatForm(
            origin,
            int(np.prod(shape)),
            spread,
            gather,
            lambda weight: gather(weight[None])[0],
            size**2,
            usual_loss,
        )
    # A wave is free in its phase: its cosine and its sine.
    phases = (1, -1j) if scale.turns else (1,)
    made = np.stack([scale.pattern(k, phase) for phase in phases])
    return RepeatForm(
        origin,
        len(made),
        lambda heights: np.einsum("m,mrc->rc", heights, made),
        lambda total: np.einsum("nrc,mrc->nm", total, made),
        lambda weight: np.einsum("rc,mrc->m", weight, made**2),
        np.inf,
        usual_loss,
    )


def _table(pattern: PatternMap, sd: PatternMap, *, along: str, channel: str) -> Learned:
    """A number for each row, column or cell that the pattern changes."""
    axes = [axis for axis, name in enumerate(("row", "column")) if name in along]
    # Along the other axis it is the same everywhere.
    for axis in {0, 1}.difference(axes):
        pattern, sd = pattern.take([0], axis), sd.take([0], axis)
    # Where nothing is left that a law may change, one number says so.
    used = [np.flatnonzero(pattern.any(1 - axis)) if pattern.any() else np.zeros(1, int) for axis in (0, 1)]
    cut = np.ix_(*used)
    names = tuple(("row", "column")[axis] for axis in axes)
    knots = tuple(_plain(used[axis]) for axis in axes)
    return Learned(channel, "table", names, knots, _plain(pattern[cut]), _plain(np.abs(sd[cut])))


def _allowed(values: Float[np.ndarray, "*n"], channel: str, *, usual_loss: float) -> Float[np.ndarray, "*n"]:
    """The heights within what a law may change. No law brings echoes back: where fewer than usual are lost, all are
    told above the least, up to what is lost everywhere."""
    low, high = LIMITS[channel]
    above = np.clip(-values.min(), 0, usual_loss) if channel == "drop" else 0.0
    return np.clip(values + above, low, high)


def _plain(numbers: np.ndarray) -> tuple[float, ...]:
    return tuple(float(f"{number:.6g}") for number in np.ravel(numbers))


@dataclass(frozen=True)
class LearnedRepeat:
    """A pattern, fitted."""

    repeat: Repeat
    """The pattern with the size that was fitted."""
    pattern: PatternMap
    """Its heights, in the channel's unit."""
    learned: Learned
    judged_nats: float
    """What judge scenes gain by it."""
    scenes: int
    """Number of scenes that it was fitted to."""
    grid: tuple[int, int]
    """Rows and columns."""

    @property
    def can_be_added(self) -> bool:
        """Whether its law does what the pattern shows. Where fewer echoes are lost than an effect in place says, no law
        brings them back: that effect's numbers are off, and nothing is missing."""
        return bool(np.max(np.abs(self.learned.values)) >= RULES.repeats_added_share * abs(self.repeat.size.value))


def learn_repeats(
    forms: Sequence[RepeatForm], finding: Finding, maps_with: Callable[[Sequence[Learned]], Mapping[str, Maps]]
) -> tuple[LearnedRepeat, ...]:
    """Fits the forms together. `maps_with` gives the maps that are left with laws in place, their noise fitted again;
    levels that scenes share follow from the scenes where `finding`."""
    result: dict[int, LearnedRepeat] = {}
    heights = {k: np.zeros(form.count) for k, form in enumerate(forms)}
    laws: list[Learned] = []
    for _ in range(HEIGHT_ROUNDS):
        remaining = maps_with(laws)
        for channel in dict.fromkeys(form.origin.repeat.channel for form in forms):
            of = {k: form for k, form in enumerate(forms) if form.origin.repeat.channel == channel}
            # The patterns are back in the residuals, as the model has them about what was fitted before.
            maps = remaining[channel]
            before = {k: maps.centred(maps.response(form.in_place(heights[k]))) for k, form in of.items()}
            whole = replace(maps, total=maps.centred(maps.total) + sum(before.values()))
            heights |= dict(zip(of, solve_heights(whole, list(of.values()), finding), strict=True))
            now = {k: maps.centred(maps.response(form.spread(heights[k]))) for k, form in of.items()}
            rest = whole.total - sum(now.values())
            for k, form in of.items():
                # Each pattern alone, with the others taken out: its size is told beside them.
                alone = replace(whole, total=rest + now[k])
                result[k] = _learned(form, heights[k], maps=alone, rest=rest, answer=now[k], finding=finding)
        laws = [result[k].learned for k in range(len(forms))]
    return tuple(result[k] for k in range(len(forms)))


def solve_heights(maps: Maps, forms: Sequence[RepeatForm], finding: Finding) -> list[_Heights]:
    """The heights of all forms that fit the find scenes best."""
    cuts = np.cumsum([form.count for form in forms])[:-1]
    stiff = np.concatenate([np.full(form.count, 1 / form.variance) for form in forms])

    def gathered(total: MapSums) -> _Heights:
        return np.concatenate([form.gather(total[finding]).sum(0) for form in forms])

    def normal(heights: _Heights) -> _Heights:
        parts = np.split(heights, cuts)
        pattern = np.sum([form.spread(part) for form, part in zip(forms, parts, strict=True)], axis=0)
        return gathered(maps.centred(maps.response(pattern))) + stiff * heights

    weight = maps.weight[finding].sum(0)
    steep = np.concatenate([form.information(weight) for form in forms]) + stiff
    # Heights of places that no scene shows stay 0.
    inverse = np.where(steep > 0, 1 / np.maximum(steep, 1e-12), 0)
    return np.split(conjugate_gradients(normal, gathered(maps.total), inverse), cuts)


def conjugate_gradients(normal: Callable[[_Heights], _Heights], right: _Heights, inverse: _Heights) -> _Heights:
    """x of normal(x) = right, with `inverse` as a guess of what undoes `normal`, number by number (Hestenes & Stiefel
    1952)."""
    x = np.zeros_like(right)
    residual = right.copy()
    direction = inverse * residual
    size = first = float(residual @ direction)
    for _ in range(CONJUGATE_STEPS):
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
    form: RepeatForm, heights: _Heights, *, maps: Maps, rest: MapSums, answer: MapSums, finding: Finding
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
    repeat = form.origin.sized(*_size(form, heights, maps=maps))
    # From no pattern to its maximum a parabola gains its slope less half of what bends it.
    shows = (maps.total * pattern).sum((1, 2)) - (answer * pattern).sum((1, 2)) / 2
    nats = float(shows[~finding].sum())
    return LearnedRepeat(repeat, pattern, learned, nats, int(finding.sum()), (pattern.shape[0], pattern.shape[1]))


def _size(form: RepeatForm, heights: _Heights, *, maps: Maps) -> tuple[Interval, complex]:
    """The size that all scenes show, and the phase of a wave."""
    channel, scale = form.origin.repeat.channel, form.origin.scale
    if scale.pattern is None:
        return common_size(maps, scale, channel), 1.0
    phase = complex(heights[0], -heights[1]) if scale.turns else 1.0
    pattern: PatternMap = scale.pattern(form.origin.number, phase)
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
