"""What `jaxsim discover` found, as numbers with intervals, and what an engine makes of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from jaxsim.effects import get_effect
from jaxsim.effects.chain import SensorModel
from jaxsim.files import placed, read_json

LOSSES = ("random_dropout", "random_loss", "snr_dropout", "material_dropout", "beam_dropout", "edge_dropout")
"""Effects, and the level, by which echoes are lost."""
OF_SURFACES = ("incidence_cosine", "oren_nayar", "specular_lobe", "retroreflection")
"""Effects of what surfaces return."""
OF_INTENSITY = (
    *(*OF_SURFACES, "range_falloff", "atmospheric_extinction"),
    *("beam_gain", "gamma_response", "intensity_offset", "saturation"),
)
"""Effects that change intensities, whatever the range."""
_DIGITS = 1e-4
"""By how much of it a number of verdict.json, which keeps six digits, may miss that of sensor.json."""


class Estimate(NamedTuple):
    """A fitted number and its 90 % interval; both ends are NaN where nobody gave one."""

    value: float
    low: float = math.nan
    high: float = math.nan

    def mapped(self, function: Callable[[float], float]) -> Estimate:
        """A monotone function of it."""
        low, high = sorted((function(self.low), function(self.high)))
        return Estimate(function(self.value), low, high)


@dataclass(frozen=True)
class Estimates:
    """What was found: a sensor.json, with the intervals of the verdict.json beside it where there is one."""

    effects: dict[str, dict[str, tuple[Estimate, ...]]]
    """By effect and parameter: one number, or one a beam or class; of effects that act everywhere."""
    levels: dict[str, Estimate]
    """Noise, losses and lattices that no effect explains, by the names of `effects.chain.LEVELS`."""
    learned: int = 0
    """Laws without a name."""
    in_parts: tuple[str, ...] = ()
    """Effects that act in a part of the rays or frames alone, which no engine's parameter does."""
    apart: tuple[str, ...] = ()
    """Parameters and levels of which the verdict.json has other values, so that its intervals are not of these."""

    def one(self, effect: str, parameter: str) -> Estimate | None:
        """A parameter that is one number; None where the effect was not found."""
        values = self.each(effect, parameter)
        return values[0] if values else None

    def each(self, effect: str, parameter: str) -> tuple[Estimate, ...]:
        """A parameter's values, one a beam or class; none where the effect was not found."""
        return self.effects.get(effect, {}).get(parameter, ())

    def limit(self, name: Literal["minimum_m", "maximum_m"]) -> Estimate | None:
        """An end of the ranges that `range_gate` lets through; None where it is open."""
        end = self.one("range_gate", name)
        return end if end and end.value != get_effect("range_gate").parameters[name].neutral else None

    @property
    def range_noise(self) -> Estimate | None:
        """Noise of the range as one number for all echoes; None where none was found."""
        return combined(self.one("range_noise", "sd_m"), self.levels.get("range_noise"), how=root_of_squares)

    @property
    def range_step(self) -> Estimate | None:
        """Step of the range; None where none was found."""
        return self.one("range_quantization", "step_m") or self.levels.get("range_step")


@dataclass(frozen=True)
class Setting:
    """A parameter of an engine."""

    name: str
    value: Estimate
    unit: str
    why: str
    """What of the answer it expresses, and how."""
    each: tuple[Estimate, ...] = ()
    """Of a parameter with a value a beam: all of them, top beam first."""


@dataclass(frozen=True)
class Translation:
    """An answer in an engine's own words."""

    engine: str
    settings: tuple[Setting, ...]
    cannot: dict[str, str]
    """What the engine cannot express, by effect or level, and what to do instead."""
    text: str
    """The settings in the engine's own format."""
    notes: tuple[str, ...] = ()
    """What must hold for the numbers to mean what they say."""


class Engine(NamedTuple):
    """A simulator that an answer can be written for."""

    title: str
    settings: Callable[[Estimates, Mapping[str, float]], list[Setting]]
    """What it can express; the mapping holds the values that it has now."""
    expresses: frozenset[str]
    """Effects and levels that `settings` uses."""
    instead: Mapping[str, str]
    """In words, by effect: what it cannot express, and what does it instead."""
    text: Callable[[Sequence[Setting]], str]
    suffix: str
    """Of a file in its format."""
    notes: tuple[str, ...]
    links: tuple[str, ...]
    """Its documents, of which the facts are."""
    defaults: Mapping[str, float] = {}
    """Its own values where nothing is set: those that `settings` takes into account."""
    nearest: str = ""
    """In words, of an engine that has a longest range alone: what does the shortest one instead."""
    clearer: str = ""
    """In words, of an engine whose air is never clearer than clear: what undoes haze that its frames have."""


def read_answer(path: Path) -> Estimates:
    """The answer of a sensor.json, with the intervals of the verdict.json beside it where both have the same values.

    Raises ValueError where it is none, as `SensorModel.load`, where the verdict.json is none, and where the two are of
    other numbers of beams.
    """
    model = SensorModel.load(path)
    verdict = path.with_name("verdict.json")
    intervals, missing = _intervals(verdict) if verdict.is_file() else ({}, {})
    apart: list[str] = []

    def estimates(value: Any, interval: Any, what: str) -> tuple[Estimate, ...]:
        values = value if isinstance(value, tuple | list) else (value,)
        if not _agree(values, interval, where=f"engines: {path}: {what}", other=verdict):
            apart.append(what)
            interval = None
        ends = [_ends(interval, key, len(values)) for key in ("low", "high")]
        return tuple(Estimate(float(v), low, high) for v, low, high in zip(values, *ends, strict=True))

    effects = {
        name: {
            key: estimates(value, intervals.get(name, {}).get(key), f"{name}.{key}")
            for key, value in parameters.items()
        }
        for name, parameters in model.effects
        if name not in model.regions
    }
    levels = {name: estimates(float(value), missing.get(name), name)[0] for name, value in model.levels.items()}
    return Estimates(effects, levels, len(model.learned), tuple(model.regions), tuple(apart))


def _intervals(verdict: Path) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    """What a verdict.json says of each parameter, by effect, and of each level. Raises ValueError where it is none."""
    content = read_json(verdict, by="engines")
    wrong, mend = f"engines: {verdict} is not what `jaxsim discover` writes", "move it away, or run it again"
    with placed(wrong, KeyError, TypeError, AttributeError, then=mend):
        effects = {one["name"]: dict(one.get("parameters", {})) for one in content.get("effects", [])}
        return effects, {one["name"]: one["missing"] for one in content.get("levels", [])}


def _agree(values: Sequence[float], interval: Any, *, where: str, other: Path) -> bool:
    """Whether an interval of verdict.json, where there is one, is of these values, but for the digits that it keeps."""
    theirs = interval.get("value") if isinstance(interval, dict) else None
    if theirs is None:
        return True
    theirs = theirs if isinstance(theirs, list) else [theirs]
    if len(theirs) != len(values):
        raise ValueError(
            f"{where} has {len(values)} numbers, but {other} {len(theirs)}: one of the two was cut, or is of another "
            "sensor's answer; put the two of one answer together, or move verdict.json away"
        )
    both = zip(values, theirs, strict=True)
    return all(isinstance(b, int | float) and math.isclose(a, b, rel_tol=_DIGITS, abs_tol=1e-9) for a, b in both)


def _ends(interval: Any, key: str, count: int) -> list[float]:
    """One end of a parameter's intervals as verdict.json has them: a number, or a list of one a beam or class."""
    given = interval.get(key) if isinstance(interval, dict) else None
    ends = given if isinstance(given, list) else [given] * count
    if len(ends) != count:
        return [math.nan] * count
    return [float(end) if isinstance(end, int | float) else math.nan for end in ends]


def translate(answer: Estimates, name: str, engine: Engine, *, now: Mapping[str, float] | None = None) -> Translation:
    """An answer in the words of an engine, whose settings are `now` what the mapping says, else its defaults.

    Raises ValueError for settings that nothing is made of.
    """
    if unknown := sorted({*(now or {})} - {*engine.defaults}):
        known = f"it may hold {', '.join(engine.defaults)}" if engine.defaults else "leave --now out"
        raise ValueError(f"engines: of {', '.join(unknown)} in --now nothing is made for {engine.title}; {known}")
    settings = engine.settings(answer, {**engine.defaults, **(now or {})})
    estimates = [*answer.effects, *answer.levels]
    general = (
        f"{engine.title} has no parameter for it; write its frames without it and add it behind: "
        "`jaxsim simulate --effects sensor.json`, or jaxsim.effects on polar frames"
    )
    cannot = {what: engine.instead.get(what, general) for what in estimates if what not in engine.expresses}
    if answer.limit("minimum_m") and engine.nearest:
        cannot["range_gate.minimum_m"] = engine.nearest
    haze = answer.one("atmospheric_extinction", "coefficient_per_m")
    if haze and haze.value < 0 and engine.clearer:
        cannot["atmospheric_extinction"] = engine.clearer
    cannot |= dict.fromkeys(answer.in_parts, f"it acts in a part alone, and {general}")
    if answer.learned:
        cannot["learned law"] = general
    notes = engine.notes
    if answer.apart:
        notes += (
            f"No intervals of {', '.join(answer.apart)}: the verdict.json beside the sensor.json has other values, so "
            "it is of another answer, or one of the two was edited.",
        )
    return Translation(name, tuple(settings), cannot, engine.text(settings), notes)


def combined(*parts: Estimate | None, how: Callable[[Sequence[float]], float]) -> Estimate | None:
    """Several numbers as one (a root of squares, a product ...); None where none is given. Their ends go together,
    which makes the interval rather too wide than too narrow."""
    given = [part for part in parts if part is not None]
    if not given:
        return None
    return Estimate(*(how([part[k] for part in given]) for k in range(3)))


def known(*rows: tuple[str, Estimate | None, str, str]) -> list[Setting]:
    """The settings (name, value, unit, why) whose value the answer has."""
    return [Setting(name, value, unit, why) for name, value, unit, why in rows if value is not None]


def noise_of_range(answer: Estimates, name: str) -> list[Setting]:
    """The engine's setting `name` of the range's noise; none where there is no such noise."""
    why = "noise of the range, one number for all echoes; of range_noise that at the reference power"
    return known((name, answer.range_noise, "m", why))


def mean_bias(answer: Estimates, name: str, more: str = "") -> list[Setting]:
    """The engine's setting `name` of the range's bias, which has one number for all beams; none without a bias."""
    of_beams = answer.each("beam_range_bias", "bias_m")
    bias = combined(answer.one("range_offset", "offset_m"), mean_of(of_beams) if of_beams else None, how=sum)
    why = f"range_offset, and the mean of beam_range_bias over the beams{more}"
    return known((name, bias, "m", why))


def limits_of_range(answer: Estimates, *, minimum: str, maximum: str) -> list[Setting]:
    """The engine's settings of these names for the ranges that `range_gate` lets through."""
    ends = {minimum: answer.limit("minimum_m"), maximum: answer.limit("maximum_m")}
    return known(*((name, end, "m", "range_gate") for name, end in ends.items()))


def root_of_squares(values: Sequence[float]) -> float:
    """As independent noises add up."""
    return math.sqrt(sum(value * value for value in values))


def any_loss(values: Sequence[float]) -> float:
    """Share that is lost where independent losses follow one another."""
    return 1 - math.prod(1 - value for value in values)


def mean_of(values: Sequence[Estimate]) -> Estimate:
    """The mean of numbers, with the mean of their intervals' ends."""
    return Estimate(*(sum(value[k] for value in values) / len(values) for k in range(3)))


def degrees(value: Estimate, sign: int = 1) -> Estimate:
    """Radians as degrees, turned the other way with a sign of -1."""
    return value.mapped(lambda radians: sign * math.degrees(radians))
