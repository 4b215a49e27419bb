"""The question what still repeats once everything that was named is in place, and what the patterns that do make of an
answer: they are added as laws, *none* becomes *not in the catalogue*, and the strongest is told as a closed formula
where it has one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Bool

from jaxsim.discover.add import Added
from jaxsim.discover.find.division import AllScenes, NullModel
from jaxsim.discover.law.search import VARIABLES
from jaxsim.discover.model.cast import blocks
from jaxsim.discover.model.fit import Chain, in_place
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.null_model import refitted
from jaxsim.discover.model.parameters import fitted_parameters
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.other_sides import OtherSides
from jaxsim.discover.repeats.find import FoundPattern, find_repeats
from jaxsim.discover.repeats.learn import LearnedRepeat, as_law, learn_repeats, pattern_form
from jaxsim.discover.repeats.maps import Maps, maps_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import ClosedLaw, Interval, Unexplained
from jaxsim.effects.learned import CHANGE_UNITS, Learned
from jaxsim.metrics.intervals import student_reach


@dataclass(frozen=True)
class Dense:
    """More columns of a comparison's frames than fits are given, of find and judge scenes."""

    scenes: AllScenes
    finding: Bool[np.ndarray, " n"]
    """Whether each scene is one to find with."""

    @classmethod
    def of(cls, null_model: NullModel) -> Dense:
        """The columns of a null model's frames."""
        division = null_model.division
        chosen = blocks(division.scenes, *division.scan.range_m.shape[1:], rays=RULES.repeats_rays)
        find, judge = division.parts.find, division.parts.judge
        finding = np.arange(len(find) + len(judge)) < len(find)
        return cls(AllScenes.of(null_model, division.looking_at(chosen)), finding)

    def maps(self, effects: Chain = (), noise: Noise | None = None) -> dict[str, Maps]:
        """What is left with `effects` in place, which leave `noise` (by default the null's)."""
        problem = self.scenes.problem_with(effects, noise)
        columns = self.scenes.division.scan.range_m.shape[2]
        return maps_of(problem, self.scenes.in_fit, self.scenes.scene, columns=columns)

    def learn(self, patterns: Sequence[FoundPattern], effects: Chain, noise: Noise) -> tuple[LearnedRepeat, ...]:
        """The laws of what was found on top of `effects`, which leave `noise`."""

        def maps_with(laws: Sequence[Learned]) -> Mapping[str, Maps]:
            chain = [*effects, *((as_law(law), {}) for law in laws)]
            # Laws in place leave less noise than there was.
            return self.maps(chain, refitted(in_place(null_model.problem, chain)).noise if laws else noise)

        null_model = self.scenes.null_model
        rows, columns = null_model.division.scan.range_m.shape[1:]
        usual = float(jax.nn.sigmoid(noise.drop))
        forms = [pattern_form(pattern, rows, columns, usual_loss=usual) for pattern in patterns]
        return tuple(one for one in learn_repeats(forms, self.finding, maps_with) if one.can_be_added)


def examine(null_model: NullModel, chain: Chain, noise: Noise) -> tuple[LearnedRepeat, ...]:
    """What repeats with the effects of `chain` in place, which leave `noise`, each pattern with the law that it
    makes."""
    dense = Dense.of(null_model)
    repeats = find_repeats(dense.maps(chain, noise), dense.finding)
    return dense.learn(repeats, chain, noise) if repeats else ()


def left_open(found: LearnedRepeat, added: Added) -> bool:
    """Whether a pattern of a row is no more than an effect with a number for each beam leaves open of that beam's: it
    was fitted to few of the columns, and here more are looked at. Its number is off then, and nothing is missing."""
    repeat = found.repeat
    if repeat.scale != "row":
        return False
    rows = np.flatnonzero(np.abs(found.pattern).max(axis=1))
    if not rows.size:
        # Fitted, it is nothing.
        return True
    for one, told in zip(added.refits, added.parameters, strict=True):
        if repeat.channel not in one.effect.channels:
            continue
        for name, p in fitted_parameters(one.effect).items():
            beams = told[name]
            if isinstance(beams, tuple) and p.shape == "row" and p.unit == CHANGE_UNITS[repeat.channel]:
                beam = beams[rows[0]]
                # Of losses on top of others the height is that of what the others leave.
                height = abs(repeat.size.value) * (1 - beam.value if repeat.channel == "drop" else 1)
                if height <= max(beam.high - beam.value, beam.value - beam.low):
                    return True
    return False


def one_sided(repeats: Sequence[LearnedRepeat], other: OtherSides) -> tuple[tuple[LearnedRepeat, ...], tuple[str, ...]]:
    """The patterns that other sides do not show as well, and the formulas of those that they do."""
    maps = Dense.of(other.null_model).maps()
    one_side, both = [], []
    for learned in repeats:
        channel = learned.repeat.channel
        alike = channel in other.channels and size_of(learned, maps[channel]) >= RULES.elsewhere_share
        (both if alike else one_side).append(learned)
    return tuple(one_side), tuple(learned.repeat.formula for learned in both)


def size_of(learned: LearnedRepeat, maps: Maps) -> float:
    """Size of a pattern in other maps, over its own; negative where they show the opposite."""
    # What these maps would show of the pattern if it were there: weights and levels take up a part.
    response = maps.centred(maps.response(learned.pattern))
    steep = float((response * learned.pattern).sum())
    return float((maps.centred(maps.total) * learned.pattern).sum()) / steep if steep > 0 else 0.0


def with_repeats(added: Added, laws: Sequence[Learned]) -> Added:
    """The sensor model with the laws of what repeats, after all others."""
    effects_model = replace(added.effects_model, learned=(*added.effects_model.learned, *laws))
    return replace(added, effects_model=effects_model, repeated=tuple(as_law(law) for law in laws))


def with_what_repeats(answer: Answer, first: LearnedRepeat) -> Answer:
    """The answer, if something repeats: it is not *none*; and what is left unexplained, where nothing else is."""
    if answer.verdict != "none":
        return answer if answer.unexplained else replace(answer, unexplained=_unexplained(first))
    return replace(answer, verdict="not_in_catalogue", unexplained=_unexplained(first))


def _unexplained(learned: LearnedRepeat) -> Unexplained:
    repeat, law = learned.repeat, learned.learned
    character = "periodic" if repeat.scale in ("wave", "parity") else "other"
    # Odd against even rows are told as rows.
    names = {name.replace("even ", "").removesuffix("s") for name in law.covariates}
    covariate = " x ".join(name for name in ("row", "column") if name in names)
    unexplained = Unexplained(repeat.channel, covariate, character, repeat.formula)
    if law.kind == "table" and len(law.knots) == 1:
        along = law.covariates[0] if law.covariates[0] != covariate else ""
        band = tuple(float(student_reach(learned.scenes)) * sd for sd in law.sd)
        return replace(unexplained, x=law.knots[0], y=law.values, band=band, along=along)
    return unexplained


def formula_of(repeats: Sequence[LearnedRepeat]) -> ClosedLaw | None:
    """The formula of the first pattern, if it is a wave, or of odd against even rows or columns."""
    if not repeats:
        return None
    first, law = repeats[0], repeats[0].learned
    size, unit = first.repeat.size, CHANGE_UNITS[law.channel]
    if law.kind == "wave":
        # The law has a cosine and a sine: together one sine with a phase.
        phase = float(np.arctan2(law.values[0], law.values[1]))
        reach = float(student_reach(first.scenes))
        off = reach * float(np.mean(law.sd)) / max(np.hypot(law.values[0], law.values[1]), 1e-9)
        periods = dict(zip(law.covariates, (1 / turns for [turns] in law.knots), strict=True))
        single = len(periods) == 1
        key = {name: "period" if single else f"{name}_period" for name in periods}
        angle = " + ".join(f"{name} / {key[name]}" for name in periods)
        turns = " + ".join(f"{name}/{period:.4g}" for name, period in periods.items())
        expression = f"level + size * sin(2 * pi * {angle if single else f'({angle})'} + phase)"
        formula = f"{size.value:.3g}·sin(2π·({turns}) {phase:+.3g})"
        # A wave of drops swings about a level of its own height.
        numbers = {
            "level": Interval.exact(size.value if law.channel == "drop" else 0.0, unit),
            "size": size,
            "phase": Interval.about(phase, off, "rad"),
            **{key[name]: Interval.exact(period, "") for name, period in periods.items()},
        }
        nodes = 2 if single else 4
    elif law.covariates in (("even rows",), ("even columns",)):
        variable, _ = VARIABLES[law.covariates[0]]
        level = law.values[0]
        # What is added is told, which stays within what a law may change.
        size = size.moved(law.values[1] - level - size.value)
        expression = f"level + size * {variable}"
        formula = f"{level:.3g} + {size.value:.3g}·{variable}"
        numbers = {"level": Interval.exact(level, unit), "size": size}
        nodes = 1
    else:
        return None
    # It holds for every row and column that there is.
    ends = {"row": first.grid[0] - 1.0, "column": first.grid[1] - 1.0, "even rows": 1.0, "even columns": 1.0}
    return ClosedLaw(
        channel=law.channel,
        covariates=law.covariates,
        formula=formula,
        expression=expression,
        parameters=numbers,
        limits={VARIABLES[name][0]: (0.0, ends[name]) for name in law.covariates},
        nodes=nodes,
        held_out_nats=first.judged_nats,
        share=1.0,
    )
