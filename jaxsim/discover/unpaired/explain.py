"""The entries of a verdict where the streets differ: what was named, what ranked below, where, and notes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool

from jaxsim.discover.explain import gain_interval, named_effect
from jaxsim.discover.model.lattice import FINEST
from jaxsim.discover.rules import RULES
from jaxsim.discover.unpaired.conditional import Conditional
from jaxsim.discover.unpaired.effect_columns import INCIDENCE_SET, untold
from jaxsim.discover.unpaired.lost import Losses
from jaxsim.discover.unpaired.read import UnpairedComparison
from jaxsim.discover.unpaired.refine import Refined
from jaxsim.discover.unpaired.select import Candidate, Choice
from jaxsim.discover.verdict import Interval, Named, Rank, Where
from jaxsim.effects import EFFECTS
from jaxsim.effects.chain import SensorModel


def named_by_law(comparison: UnpairedComparison, choice: Choice, refined: Refined) -> list[Named]:
    """Effects on the law of ln I."""
    entries = []
    for step, parameters in zip(choice.steps, refined.intervals, strict=True):
        effect = step.chosen.effect
        alike = [one.name for one in step.alike]
        if not comparison.shared_classes and effect.name in INCIDENCE_SET:
            alike += [name for name in INCIDENCE_SET if name != effect.name and name not in alike]
        entries.append(
            named_effect(
                effect,
                p_value=step.chosen.chance,
                gain=gain_interval(step.chosen.by_scene),
                parameters=parameters,
                alike=alike,
                remedy="frames of the same streets on both sides",
            )
        )
    return entries


def named_by_losses(lost: Losses) -> list[Named]:
    """Effects on returns."""
    return [
        named_effect(EFFECTS[one.name], p_value=one.p_value, gain=one.share, parameters=dict(one.parameters))
        for one in lost.effects
    ]


def named_by_values(comparison: UnpairedComparison, find: Bool[np.ndarray, " s"]) -> list[Named]:
    """Rounding, read off the values: each measured scene shows it, and its gain is what lying on a lattice saves."""
    scenes = int((find & comparison.measured).sum())
    simulated_frames, _ = comparison.frames
    returns = float((~comparison.lost[simulated_frames:]).sum() / comparison.measured.sum())
    entries = []
    for name, step in comparison.steps.items():
        gain = returns * float(np.log(step / FINEST[name]))
        parameter = next(iter(EFFECTS[name].parameters))
        entries.append(
            named_effect(
                EFFECTS[name],
                p_value=2.0**-scenes,
                gain=Interval(gain, gain, gain, "nats per scene"),
                parameters={parameter: Interval(step, step, step, "")},
            )
        )
    return entries


def sensor_of(named: Sequence[Named]) -> SensorModel:
    """The sensor model that an answer adds up to."""
    values: dict[str, dict[str, Any]] = {}
    for one in named:
        values[one.name] = {
            name: value.value if isinstance(value, Interval) else tuple(v.value for v in value)
            for name, value in one.parameters.items()
        }
    return SensorModel(tuple(values.items()))


def where(problem: Conditional, curves: Sequence[Candidate]) -> tuple[Where, ...]:
    """The covariates along which free curves gain."""
    squares = 2 * problem.equations.square[problem.find].sum()
    return tuple(
        Where("intensity", one.name, one.chance, float(max(2 * one.total / squares, 0.0)))
        for one in curves
        if one.chance <= RULES.unpaired_agreement_level and one.total > 0
    )


def ranking(choice: Choice) -> tuple[Rank, ...]:
    """The first step's best candidates and why each was not named."""
    return tuple(
        Rank(one.name, one.total / max(len(one.by_scene), 1), one.chance, 0.0, why_not(one, choice))
        for one in choice.first_ranking[: RULES.candidates_listed]
    )


def why_not(candidate: Candidate, choice: Choice) -> str:
    """Why a candidate of the first step is not what was named first; empty if it is."""
    first = choice.steps[0] if choice.steps else None
    if first and candidate.name == first.chosen.name:
        return ""
    if first and candidate.name in {one.name for one in first.alike}:
        return "these data cannot tell it from the one that is named"
    if candidate.accepted:
        return "it explains clearly less than the one that is named"
    if candidate.chance <= RULES.unpaired_level:
        level = RULES.unpaired_agreement_level
        return f"held-out scenes disagree on it (p {candidate.agreement:.2g}, must be {level:g})"
    return (
        f"scenes exchanged between the sides reach as much (p {candidate.chance:.2g}, must be {RULES.unpaired_level:g})"
    )


def notes(comparison: UnpairedComparison, find: Bool[np.ndarray, " s"], lost: Losses) -> tuple[str, ...]:
    """What a reader must know."""
    classes = "classes, " if comparison.shared_classes else ""
    lines = [
        "the two sides show different streets: what is compared is how readings depend on range, incidence, row, "
        f"azimuth, {classes}height and kind of surface, not ray by ray; it is assumed that at equal values of these "
        "the streets hold the same mix of materials",
        *comparison.notes,
        f"cannot be told unpaired: {', '.join(untold(classes=comparison.shared_classes))}",
    ]
    if not comparison.shared_classes:
        lines.append("classes (semantic) in both folders would let effects of single classes be told too")
    if comparison.noise_m > 0:
        lines.append(
            f"simulated ranges were given the noise of measured ones ({100 * comparison.noise_m:.1f} cm) before "
            "angles were taken from them"
        )
    if find.sum() < RULES.unpaired_few_scenes:
        lines.append(f"{find.sum()} scenes to find with are few: weak effects cannot be told from none")
    return (*lines, *lost.notes)
