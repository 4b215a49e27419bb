"""Add: the named effects fitted together, as they enter the sensor model, with intervals of their parameters; and
with them the law that was learned of what no effect describes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.discover.law.learn import Form, LearnedFit, learn
from jaxsim.discover.model.fit import ANSWER_STEPS, NOISE_SD, Chain, Fit, Objective, Problem, fit, on_top
from jaxsim.discover.model.likelihood import step_known_to
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.null_model import Refit, as_implied, refit
from jaxsim.discover.model.parameters import fitted_parameters, host_values, ravel, restorer, to_values, to_z
from jaxsim.discover.name.select import FittedStep
from jaxsim.discover.name.starts import sector_between
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Interval
from jaxsim.effects import Law
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.region import Region
from jaxsim.metrics.intervals import student_reach

DIFFERENCE = 0.02
"""Step of the central differences, in z and in nats of a noise scale."""
BOUND = 1e-6
"""Distance from a bound at which a value counts as held there."""

_Numbers = Float[np.ndarray, "*k"] | np.floating
"""A parameter's: arithmetic on an array without dimensions gives a NumPy scalar."""


@dataclass(frozen=True)
class Added:
    """The named effects in the sensor model."""

    refits: tuple[Refit, ...]
    parameters: tuple[dict[str, Interval | tuple[Interval, ...]], ...]
    """Parameters of each effect, with their intervals."""
    effects_model: SensorModel
    law_refits: tuple[Refit, ...] = ()
    """The learned law, fitted with them."""
    learned: LearnedFit | None = None
    repeated: tuple[Law, ...] = ()
    """What repeats in sensor coordinates, as laws without parameters; part of `effects_model` too."""

    @property
    def chain(self) -> Chain:
        """The effects and the learned laws, and their z."""
        named = [(refit.effect, refit.fit.z) for refit in (*self.refits, *self.law_refits)]
        return [*named, *((law, {}) for law in self.repeated)]


def add_effects(
    null: Problem,
    steps: Sequence[FittedStep],
    *,
    known: SensorModel,
    form: Form | None = None,
    regions: Mapping[str, Region] | None = None,
) -> Added:
    """The effects of `steps`, and the law of a `form`, fitted again with one another in place, after what is `known` of
    the sensor model. `regions` are those that effects act in, by name."""
    laws: list[Law] = [step.chosen.effect for step in steps]
    z = [step.fit.z for step in steps]
    if form:
        # Last, as learned laws act after all effects.
        laws.append(form.law)
        z.append(to_z(form.law, {"height": form.start}, null.ev.rays.row.shape[-1]))
    again = refit(null, laws, z)
    refits, law_refits = again[: len(steps)], again[len(steps) :]
    named = [(one.effect.plain_name, parameters_of(one.effect, one.fit.z)) for one in refits]
    learned = learn(form, law_refits[0].problem, law_refits[0].fit) if form else None
    laws_learned = (*known.learned, *((learned.learned,) if learned else ()))
    return Added(
        refits,
        tuple(intervals(one.effect, one.problem, one.fit) for one in refits),
        SensorModel((*known.effects, *named), learned=laws_learned, regions={**known.regions, **(regions or {})}),
        law_refits,
        learned,
    )


def effect_on_rays(null: Problem, named: Refit) -> dict[str, Interval]:
    """What a named effect alone changes on the rays that are compared, by channel: the mean, and the 5th and 95th
    percentile. Nuisances take up much of it in the gap; of an effect that scatters, rounds or adds returns, nothing."""
    before = null.ev.rays
    after = on_top(named.effect, null, named.fit.z, simulated=True).ev.rays
    both = np.asarray(before.hit & after.hit)
    intensity = np.expm1(np.asarray(after.log_intensity) - np.asarray(before.log_intensity))
    lost = -np.expm1(np.asarray(after.log_keep) - np.asarray(before.log_keep))
    change = {
        "intensity": (intensity, "share of the intensity"),
        "range": (np.asarray(after.reading_m) - np.asarray(before.reading_m), "m"),
        "drop": (lost, "share of the returns"),
    }
    of_channels = {
        name: (values[both], unit) for name, (values, unit) in change.items() if name in named.effect.channels
    }
    return {
        name: Interval(float(values.mean()), *np.quantile(values, [0.05, 0.95]).tolist(), unit=unit)
        for name, (values, unit) in of_channels.items()
        if values.any()
    }


def parameters_of(effect: Law, z: dict[str, Any]) -> dict[str, Any]:
    """Parameters as sensor.json holds them, within their bounds."""
    values = {}
    for name, p in effect.parameters.items():
        value = np.clip(np.asarray(to_values(effect, z)[name], float), p.low, p.high)
        values[name] = float(value) if value.ndim == 0 else tuple(value.tolist())
    return values


def variances(effect: Law, problem: Problem, result: Fit) -> Float[np.ndarray, " k"]:
    """Variance of every z, in the raveled order: the larger of the curvature's and the sandwich's of White (1982),
    whose filling is the scatter of the scenes' slopes."""
    scene = np.asarray(problem.ev.scene)
    objective = Objective(effect, problem)
    x = ravel((result.z, result.noise))
    hessian = np.diag(1 / objective.sd**2)
    # Two gradients at both sides of the fit, column by column: the likelihood has no second derivative at hand.
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = DIFFERENCE
        hessian[k] += (objective.data(x + step)[1] - objective.data(x - step)[1]) / (2 * DIFFERENCE)
    # A rate at its bound stays there: it is no direction in which anything can move.
    fixed = [
        (low is not None and v <= low + BOUND) or (high is not None and v >= high - BOUND)
        for v, (low, high) in zip(x, objective.bounds, strict=True)
    ]
    # The effect's own numbers are asked about even where they rest at a bound.
    free = ~np.array(fixed) | (np.arange(len(x)) < objective.own)
    values, vectors = np.linalg.eigh(((hessian + hessian.T) / 2)[np.ix_(free, free)])
    # Where rays change surface the slope jumps, and a curvature may come out negative: its size is what counts.
    inverse = np.zeros_like(hessian)
    inverse[np.ix_(free, free)] = (vectors / np.maximum(np.abs(values), 1 / NOISE_SD**2)) @ vectors.T
    scenes = np.unique(scene)
    slopes = np.stack([objective.data(x, (scene == drive).astype(np.float32))[1] for drive in scenes])
    slopes = slopes - slopes.mean(0)
    scatter = slopes.T @ slopes * len(scenes) / max(len(scenes) - 1, 1)
    sandwich = inverse @ scatter @ inverse
    return np.maximum(np.diag(sandwich), np.diag(inverse))[: objective.own]


def intervals(effect: Law, problem: Problem, result: Fit) -> dict[str, Interval | tuple[Interval, ...]]:
    """Every fitted parameter with its 90 % interval, clipped to its bounds; of a lattice's step, which was read off the
    readings, how far it may be off; of a hidden sector's borders, the rays between which they lie."""
    if effect.name in FINEST:
        [(name, value)] = to_values(effect, result.z).items()
        half = step_known_to(problem.ev, effect.name, float(value))
        return {name: Interval.about(float(value), half, effect.parameters[name].unit)}
    sd = np.sqrt(variances(effect, problem, result))
    reach = RULES.interval_widening * float(student_reach(len(np.unique(np.asarray(problem.ev.scene)))))
    of_z = restorer(result.z)(sd)
    values = to_values(effect, result.z)
    # It reads an echo's power and leaves the intensity as it is.
    by_power = "intensity" not in effect.channels and "power" in effect.covariates
    again = to_values(effect, fit_to_implied(effect, problem, result).z) if by_power else values
    between = sector_between(problem, values) if effect.name == "sector_occlusion" else {}
    parameters: dict[str, Interval | tuple[Interval, ...]] = {}
    for name, p in fitted_parameters(effect).items():
        value = np.asarray(values[name], float)
        half = reach * p.scale * np.asarray(of_z[name], float)
        # The interval holds both fits: to the simulator's reflectances, and to those that the intensities imply.
        other = np.asarray(again[name], float)
        ends = np.minimum(value, other) - half, np.maximum(value, other) + half
        if name in between:
            # Between two rays all values are as likely: no curvature tells how far they reach.
            ends = np.minimum(value, between[name][0]), np.maximum(value, between[name][1])
        low, high = np.maximum(ends[0], p.low), np.minimum(ends[1], p.high)
        parameters[name] = interval_of(value, low, high, unit=p.unit)
    return parameters


def may_never_act(step: FittedStep, problem: Problem) -> bool:
    """Whether the 90 % interval of an effect's probability, fitted to a problem, holds none. Of effects without a
    single probability the gain alone tells whether they are there."""
    effect = step.chosen.effect
    probability = effect.parameters.get("probability")
    if probability is None or probability.shape != "scalar":
        return False
    interval = intervals(effect, problem, step.fit)["probability"]
    return isinstance(interval, Interval) and interval.low <= probability.neutral


def interval_of(value: _Numbers, low: _Numbers, high: _Numbers, *, unit: str) -> Interval | tuple[Interval, ...]:
    """A parameter with its ends: one interval, or one a beam or class."""
    if value.ndim == 0:
        return Interval(float(value), float(low), float(high), unit)
    ends = zip(np.asarray(value), np.asarray(low), np.asarray(high), strict=True)
    return tuple(Interval(float(v), float(a), float(b), unit) for v, a, b in ends)


def fit_to_implied(effect: Law, problem: Problem, result: Fit) -> Fit:
    """The effect fitted again, to rays as bright as the measured intensities say that their surfaces are."""
    implied = replace(problem, ev=as_implied(problem.ev, problem.noise, problem.equations))
    return fit(effect, implied, starts=(host_values(effect, result.z),), steps=ANSWER_STEPS)
