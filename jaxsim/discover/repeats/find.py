"""What repeats on find scenes and holds on judge scenes, one pattern on top of another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Num

from jaxsim.discover.repeats.chance import Agreement, alike, of_maps, of_patterns, scatter
from jaxsim.discover.repeats.maps import Maps, Pattern
from jaxsim.discover.repeats.scales import Scale, scales
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import p_value, signs_of, student_reach
from jaxsim.discover.verdict import Interval, Repeat

UNITS = {"intensity": "nats", "range": "m", "drop": "share of rays"}
LETTER = {"intensity": "Δ ln I", "range": "Δ r", "drop": "Δ p(drop)"}
"""What a formula says of each channel."""


def find_repeats(
    maps: Mapping[str, Maps], finding: Bool[np.ndarray, " n"], *, bins: int, rounds: int = RULES.repeats_tried
) -> tuple[Repeat, ...]:
    """Patterns that scenes where `finding` share, and the others confirm, most certain first; each is looked for with
    the ones before taken out, and the chance of having looked at all scales, places and channels is paid for.

    `bins` is the number of columns that a frame shows, the finest division of the image into places.
    """
    signs = signs_of(int(finding.sum()))
    left = {channel: replace(one, total=one.centred(one.total)) for channel, one in maps.items()}
    looked = {channel: Look.at(one, finding, signs, bins=bins) for channel, one in left.items() if one.weight.any()}
    found: list[Repeat] = []
    for _ in range(rounds):
        best = strongest(looked)
        if best is None:
            break
        channel, scale, k, p = best
        known = left[channel]
        phase = complex(looked[channel].sums[scale.name, scale.along][finding, k].sum()) if scale.pattern else 1.0
        # Where all patterns are asked about, the mean map of the find scenes is what judge scenes must show again.
        pattern = scale.pattern(k, phase) if scale.pattern else mean_map(known, finding, scale)
        response = known.centred(known.left(pattern))
        shows = np.einsum("nrc,rc->n", known.total, pattern)
        answers = np.einsum("nrc,rc->n", response, pattern)
        height = shows[finding].sum() / max(answers[finding].sum(), 1e-12)
        p_judge = p_value(np.sign(height) * shows[~finding])
        size = height_of(shows, answers, channel) if scale.pattern else common_size(known, scale, channel)
        if convincing(size, channel, p_judge, int((~finding).sum())):
            found.append(_repeat(channel, scale, k, phase, size=size, p=p, p_judge=p_judge))
        left[channel] = replace(known, total=known.total - height * response)
        looked[channel] = Look.at(left[channel], finding, signs, bins=bins)
    return tuple(sorted(found, key=lambda one: one.p_value))


@dataclass(frozen=True)
class Look:
    """All scales of one channel."""

    scales: list[Scale]
    sums: dict[tuple[str, str], Num[np.ndarray, "n _"]]
    """Of each scale by name and axis."""
    agreement: list[Agreement]

    @classmethod
    def at(cls, maps: Maps, finding: Bool[np.ndarray, " n"], signs: Float[np.ndarray, "f n"], *, bins: int) -> Look:
        """At a channel's maps, already centred."""
        known = scales(*maps.total.shape[1:], bins=bins)
        sums = {(one.name, one.along): one.sums(maps.total) for one in known}
        seen = {key: one[finding] for key, one in sums.items()}
        worth = {(one.name, one.along): one.information(maps.weight[finding]) for one in known}
        usual = {key: scatter(seen[key], worth[key]) for key in seen}
        agreement = []
        for one in known:
            key = one.name, one.along
            if one.pattern is None:
                agreement.append(of_maps(seen[key], worth[key], signs))
            else:
                # A parity is the shortest of waves, and scatters like these.
                kind = ("wave", one.along) if one.name == "parity" else key
                agreement.append(of_patterns(seen[key], worth[key], signs, usual=usual[kind]))
        return cls(known, sums, agreement)


def strongest(looked: Mapping[str, Look]) -> tuple[str, Scale, int, float] | None:
    """The pattern that explains most of those that chance does not: channel, scale, number, and its probability. One
    pattern is told rather than all together where it explains `Rules.repeats_one_pattern` of what these do."""
    if not looked:
        return None
    by_chance = np.max([one.by_chance for look in looked.values() for one in look.agreement], axis=0)
    best, most = None, 0.0
    for channel, look in looked.items():
        for scale, one in zip(look.scales, look.agreement, strict=True):
            p = np.array([np.mean(by_chance >= strength - 1e-9) for strength in one.strength.tolist()])
            gain = np.where(p <= RULES.repeats_level, one.gain * (1 if scale.pattern else RULES.repeats_one_pattern), 0)
            k = int(gain.argmax())
            if gain[k] > most:
                best, most = (channel, scale, k, float(p[k])), float(gain[k])
    return best


def mean_map(maps: Maps, finding: Bool[np.ndarray, " n"], scale: Scale) -> Pattern:
    """The find scenes' mean residual of each row, column or cell; 0 where there is none."""
    axis = {"row": (0, 2), "column": (0, 1)}.get(scale.along, (0,))
    weight = maps.weight[finding].sum(axis, keepdims=True)[0]
    total = maps.total[finding].sum(axis, keepdims=True)[0]
    mean = np.where(weight > 0, total / np.maximum(weight, 1e-12), 0)
    return np.broadcast_to(mean, maps.total.shape[1:]).copy()


def convincing(size: Interval, channel: str, p_judge: float, judges: int) -> bool:
    """Whether the pattern matters, and judge scenes show it again, with the same sign and phase."""
    least = {"intensity": RULES.repeats_least_nats, "range": RULES.repeats_least_m, "drop": RULES.repeats_least_lost}
    return abs(size.value) >= least[channel] and p_judge <= max(RULES.repeats_judge_level, 1.01 * 2.0**-judges)


def height_of(shows: Float[np.ndarray, " n"], answers: Float[np.ndarray, " n"], channel: str) -> Interval:
    """What scenes show of a pattern over what they would of one of height 1."""
    without = (shows.sum() - shows) / np.maximum(answers.sum() - answers, 1e-12)
    return _interval(shows.sum() / max(answers.sum(), 1e-12), without, channel)


def common_size(maps: Maps, scale: Scale, channel: str) -> Interval:
    """Root mean square of the pattern that scenes have in common: what products of any two scenes' maps add up to, over
    what they would if a pattern of random signs and height 1 were all that is there."""
    grid = maps.total.shape[1:]
    shape = [count if name in scale.along else 1 for count, name in zip(grid, ("row", "column"), strict=True)]
    made = np.broadcast_to(np.random.default_rng(0).choice([-1.0, 1.0], shape), grid).copy()
    shows, answers = (alike(scale.sums(one)).sum(1) for one in (maps.total, maps.centred(maps.left(made))))
    # A product belongs to both of its scenes: without one of them, what it shares with all others goes twice.
    without = (shows.sum() - 2 * shows) / np.maximum(answers.sum() - 2 * answers, 1e-12)
    square = shows.sum() / max(answers.sum(), 1e-12)
    return _interval(np.sqrt(max(square, 0)), np.sqrt(np.maximum(without, 0)), channel)


def _interval(value: float, without: Float[np.ndarray, " n"], channel: str) -> Interval:
    """With what the value becomes `without` each of the scenes: the jackknife."""
    n = len(without)
    half = float(student_reach(n) * np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum()))
    return Interval(float(value), float(value) - half, float(value) + half, UNITS[channel])


def _repeat(channel: str, scale: Scale, k: int, phase: complex, *, size: Interval, p: float, p_judge: float) -> Repeat:
    height = f"{LETTER[channel]} ≈ {size.value:.3g}"
    formula = f"{height}·{scale.formula(k, phase)}" if scale.formula else f"{height}, {scale.words(k)}"
    return Repeat(channel, scale.name, scale.along, scale.words(k), scale.period(k), formula, size, p, p_judge)
