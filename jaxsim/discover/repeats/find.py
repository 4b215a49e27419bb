"""What repeats on find scenes and holds on judge scenes, one pattern on top of another, and how large it is.

How far scenes agree on patterns is held against how often chance makes some pattern agree as well (max-T over all). A
scene's residuals are as likely as their negative where nothing repeats, scene by scene; so all scales and channels take
the same signs, and the largest of all statistics under each choice of signs gives exact probabilities that pay for
having looked everywhere (Westfall & Young 1993). Every spread by which a statistic is divided stays the same when
scenes change their signs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Num

from jaxsim.discover.name.unexplained import LETTER
from jaxsim.discover.repeats.maps import Maps, PatternMap, PatternScale, scales
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import attainable, p_value, signs_of
from jaxsim.discover.verdict import Interval, Repeat
from jaxsim.metrics.intervals import jackknife_half_width

SIGNS_AT_ONCE = 256
"""Choices of signs that are looked at together."""
HEIGHT_UNITS = {"intensity": "nats", "range": "m", "drop": "share of rays"}
"""Units of a pattern's height."""
LETTERS = {**LETTER, "drop": "Δ p(drop)"}
"""What a formula says of each channel."""
LEAST_HEIGHT = {
    "intensity": RULES.repeats_least_nats,
    "range": RULES.repeats_least_m,
    "drop": RULES.repeats_least_lost,
}
"""Heights below which a pattern does not count."""


@dataclass(frozen=True)
class Agreement:
    """How far scenes agree on k patterns."""

    strength: Float[np.ndarray, " k"]
    """|sum over scenes| in units of its spread."""
    by_chance: Float[np.ndarray, " f"]
    """The largest strength under each choice of signs."""
    gain: Float[np.ndarray, " k"]
    """The part of the squared sum that two scenes share, per unit of information: patterns of all scales compare."""


def scatter(sums: Num[np.ndarray, "n k"], information: Float[np.ndarray, " k"]) -> float:
    """How much patterns of one kind scatter from scene to scene, over what the weights say."""
    return float((np.abs(sums) ** 2).sum() / max(information.sum(), 1e-12))


def of_patterns(
    sums: Num[np.ndarray, "n k"],
    information: Float[np.ndarray, " k"],
    signs: Float[np.ndarray, "f n"],
    *,
    usual: float,
) -> Agreement:
    """Asks of each pattern alone. `information` is its sum's variance as the weights have it, all scenes together;
    `usual` the `scatter` of its kind.

    Half of the spread is what a pattern scatters by itself, half what its kind does: few scenes that are alike by
    chance, or a place at which nothing rare happened, must not look sure.
    """
    squares = (np.abs(sums) ** 2).sum(0)
    spread = np.sqrt((squares + usual * information) / 2)
    # A pattern that no scene shows anything of is infinitely unsure, not 0 / 0.
    spread = np.where(spread > 1e-9 * max(spread.max(initial=0), 1e-12), spread, np.inf)
    scaled = sums / spread
    by_chance = [
        np.abs(signs[k : k + SIGNS_AT_ONCE] @ scaled).max(1, initial=0) for k in range(0, len(signs), SIGNS_AT_ONCE)
    ]
    # A wave's size is told by cosines and sines, each of half its sum's variance.
    shared = (np.abs(sums.sum(0)) ** 2 - squares) * (2 if np.iscomplexobj(sums) else 1)
    return Agreement(np.abs(scaled.sum(0)), np.concatenate(by_chance), shared / np.maximum(information, 1e-12))


def of_maps(
    sums: Float[np.ndarray, "n k"], information: Float[np.ndarray, " k"], signs: Float[np.ndarray, "f n"]
) -> Agreement:
    """Asks of all patterns together: whether the maps of scenes resemble each other, pair by pair, whatever they show.
    One statistic, which sees also what each place alone is too weak, or too rarely seen, to show."""
    pairs = scene_products(sums)
    spread = np.sqrt((pairs**2).sum() / 2)
    if spread <= 0:
        return Agreement(np.zeros(1), np.zeros(len(signs)), np.zeros(1))
    # Scenes of one sign for all places: what is asked is whether maps agree, not where.
    by_chance = ((signs @ pairs) * signs).sum(1) / 2 / spread
    observed = np.array([pairs.sum() / 2 / spread])
    squares = (sums**2).sum(0)
    gain = np.where(information > 0, (sums.sum(0) ** 2 - squares) / np.maximum(information, 1e-12), 0)
    return Agreement(_as_one(observed, len(sums)), _as_one(by_chance, len(sums)), np.array([gain.sum()]))


def _as_one(pairwise: Float[np.ndarray, " f"], scenes: int) -> Float[np.ndarray, " f"]:
    """Strength of pairs on the scale of patterns: of scenes all alike both are the same under any signs. Otherwise a
    scene's change of sign would leave pairs stronger than any single pattern can be."""
    return np.sqrt(2 * np.maximum(1 + pairwise * np.sqrt(2 * (scenes - 1) / scenes), 0))


def scene_products(sums: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n n"]:
    """Products of each two scenes' maps, 0 of a scene with itself."""
    pairs = sums @ sums.T
    np.fill_diagonal(pairs, 0)
    return pairs


@dataclass(frozen=True)
class FoundPattern:
    """A pattern that repeats."""

    repeat: Repeat
    scale: PatternScale
    number: int
    """Number of the pattern among the scale's."""
    phase: complex
    """Phase of a wave, as a complex number."""

    @property
    def key(self) -> tuple[str, str, str, int]:
        """What its law is of, whatever its size and phase."""
        return self.repeat.channel, self.scale.name, self.scale.along, self.number

    def sized(self, size: Interval, phase: complex) -> Repeat:
        """The pattern in words, of another size and phase."""
        formula = pattern_formula(self.repeat.channel, self.scale, self.number, size=size, phase=phase)
        return replace(self.repeat, size=size, formula=formula)


def find_repeats(
    maps: Mapping[str, Maps],
    finding: Bool[np.ndarray, " n"],
    *,
    rounds: int = RULES.repeats_tried,
    least: Mapping[str, float] = LEAST_HEIGHT,
) -> tuple[FoundPattern, ...]:
    """Patterns that scenes where `finding` share, and the others confirm, most certain first; each is looked for with
    the ones before taken out, and the chance of having looked at all scales, places and channels is paid for.

    `least` is what is too small to count, by channel, beside what rounding may do.
    """
    signs = signs_of(int(finding.sum()))
    remaining = {channel: replace(one, total=one.centred(one.total)) for channel, one in maps.items()}
    looked = {channel: ChannelScales.at(one, finding, signs) for channel, one in remaining.items() if one.weight.any()}
    patterns: list[FoundPattern] = []
    for _ in range(rounds):
        best = strongest(looked)
        if best is None:
            break
        channel, scale, k, p = best
        maps_left = remaining[channel]
        phase = complex(looked[channel].sums[scale.name, scale.along][finding, k].sum()) if scale.pattern else 1.0
        # Where all patterns are asked about, the mean map of the find scenes is what judge scenes must show again.
        pattern = scale.pattern(k, phase) if scale.pattern else mean_map(maps_left, finding, scale)
        response = maps_left.centred(maps_left.response(pattern))
        shows = np.einsum("nrc,rc->n", maps_left.total, pattern)
        answers = np.einsum("nrc,rc->n", response, pattern)
        # Judge scenes must show it with the sign that the find scenes give it.
        height = shows[finding].sum() / max(answers[finding].sum(), 1e-12)
        p_judge = p_value(np.sign(height) * shows[~finding])
        size = height_of(shows, answers, channel) if scale.pattern else common_size(maps_left, scale, channel)
        large = abs(size.value) >= np.hypot(least[channel], maps_left.rounding(pattern))
        # Of few judge scenes all must show it.
        # Of what was found before, another phase may be left: its law has both.
        new = (channel, scale.name, scale.along, k) not in {one.key for one in patterns}
        if new and large and p_judge <= attainable(RULES.repeats_judge_level, int((~finding).sum())):
            formula = pattern_formula(channel, scale, k, size=size, phase=phase)
            repeat = Repeat(
                channel, scale.name, scale.along, scale.words(k), scale.period(k), formula, size, p, p_judge
            )
            patterns.append(FoundPattern(repeat, scale, k, phase))
        # Too small or not confirmed, it is taken out all the same: what lies beneath it shows.
        remaining[channel] = replace(maps_left, total=maps_left.total - height * response)
        looked[channel] = ChannelScales.at(remaining[channel], finding, signs)
    return tuple(sorted(patterns, key=lambda pattern: pattern.repeat.p_value))


@dataclass(frozen=True)
class ChannelScales:
    """All scales of one channel."""

    scales: list[PatternScale]
    sums: dict[tuple[str, str], Num[np.ndarray, "n _"]]
    """Sums of each scale's patterns, by its name and axis."""
    agreement: list[Agreement]

    @classmethod
    def at(cls, maps: Maps, finding: Bool[np.ndarray, " n"], signs: Float[np.ndarray, "f s"]) -> ChannelScales:
        """Looks at a channel's maps, already centred."""
        every = scales(*maps.total.shape[1:])
        sums = {(scale.name, scale.along): scale.sums(maps.total) for scale in every}
        seen = {key: sums_of[finding] for key, sums_of in sums.items()}
        worth = {(scale.name, scale.along): scale.information(maps.weight[finding]) for scale in every}
        usual = {key: scatter(seen[key], worth[key]) for key in seen}
        agreement = []
        for scale in every:
            key = scale.name, scale.along
            if scale.pattern is None:
                agreement.append(of_maps(seen[key], worth[key], signs))
            else:
                # A parity is the shortest of waves, and scatters like these.
                kind = ("wave", scale.along) if scale.name == "parity" else key
                agreement.append(of_patterns(seen[key], worth[key], signs, usual=usual[kind]))
        return cls(every, sums, agreement)


def strongest(looked: Mapping[str, ChannelScales]) -> tuple[str, PatternScale, int, float] | None:
    """The pattern that explains most of those that chance does not: channel, scale, number, and its probability. One
    pattern is told rather than all together where it explains `Rules.repeats_one_pattern` of what these do."""
    if not looked:
        return None
    # Max-T: one draw of signs serves all channels, and its largest strength pays for having looked everywhere.
    by_chance = np.max([agreement.by_chance for look in looked.values() for agreement in look.agreement], axis=0)
    best, most = None, 0.0
    for channel, look in looked.items():
        for scale, agreement in zip(look.scales, look.agreement, strict=True):
            p = np.array([np.mean(by_chance >= strength - 1e-9) for strength in agreement.strength.tolist()])
            part = 1 if scale.pattern else RULES.repeats_one_pattern
            gain = np.where(p <= RULES.repeats_level, agreement.gain * part, 0)
            # Of two rows or columns there is no wave.
            k = int(gain.argmax()) if gain.size else 0
            if gain.size and gain[k] > most:
                best, most = (channel, scale, k, float(p[k])), float(gain[k])
    return best


def mean_map(maps: Maps, finding: Bool[np.ndarray, " n"], scale: PatternScale) -> PatternMap:
    """The find scenes' mean residual of each row, column or cell; 0 where there is none."""
    axis = {"row": (0, 2), "column": (0, 1)}.get(scale.along, (0,))
    weight = maps.weight[finding].sum(axis, keepdims=True)[0]
    total = maps.total[finding].sum(axis, keepdims=True)[0]
    mean = np.where(weight > 0, total / np.maximum(weight, 1e-12), 0)
    return np.broadcast_to(mean, maps.total.shape[1:]).copy()


def height_of(shows: Float[np.ndarray, " n"], answers: Float[np.ndarray, " n"], channel: str) -> Interval:
    """What scenes show of a pattern over what they would of one of height 1."""
    without = (shows.sum() - shows) / np.maximum(answers.sum() - answers, 1e-12)
    return _interval(shows.sum() / max(answers.sum(), 1e-12), without, channel)


def common_size(maps: Maps, scale: PatternScale, channel: str) -> Interval:
    """Root mean square of the pattern that scenes have in common: what products of any two scenes' maps add up to, over
    what they would if a pattern of random signs and height 1 were all that is there."""
    grid = maps.total.shape[1:]
    shape = [count if name in scale.along else 1 for count, name in zip(grid, ("row", "column"), strict=True)]
    made = np.broadcast_to(np.random.default_rng(0).choice([-1.0, 1.0], shape), grid).copy()
    shows = scene_products(scale.sums(maps.total)).sum(1)
    answers = scene_products(scale.sums(maps.centred(maps.response(made)))).sum(1)
    # A product belongs to both of its scenes: without one of them, what it shares with all others goes twice.
    without = (shows.sum() - 2 * shows) / np.maximum(answers.sum() - 2 * answers, 1e-12)
    square = shows.sum() / max(answers.sum(), 1e-12)
    return _interval(np.sqrt(max(square, 0)), np.sqrt(np.maximum(without, 0)), channel)


def _interval(value: float, without: Float[np.ndarray, " n"], channel: str) -> Interval:
    """The interval by what the value becomes `without` each of the scenes, widened as parameters' intervals are."""
    half = RULES.interval_widening * float(jackknife_half_width(without))
    return Interval.about(float(value), half, HEIGHT_UNITS[channel])


def pattern_formula(channel: str, scale: PatternScale, k: int, *, size: Interval, phase: complex) -> str:
    """The k-th pattern of a scale as a formula, or in words where it has none."""
    height = f"{LETTERS[channel]} ≈ {size.value:.3g}"
    return f"{height}·{scale.formula(k, phase)}" if scale.formula else f"{height}, {scale.words(k)}"
