"""What an effect is: parameters, one pure function on rays, and its row of the catalogue."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import jax.numpy as jnp

from jaxsim.effects.rays import Array, Rays, Scan

STAGES = ("geometry", "surface", "path", "receiver", "detection", "ranging")
"""In physical order: effects of an earlier stage act first."""
CHANNELS = ("intensity", "range", "drop")
COVARIATES = (
    *("range", "incidence", "row", "column", "azimuth", "class", "instance", "power", "intensity", "step"),
    *("time", "frame", "speed", "rgb", "heading"),
)
"""What residuals can depend on: `step` is the depth step to a neighbour, `time` the time within the scan."""
CLASSES = 34
"""Cityscapes ids 0..33."""


@dataclass(frozen=True)
class Parameter:
    """A number of an effect, or one a beam, or one a class."""

    neutral: float
    """Value at which the effect does nothing (of the parameters that switch it)."""
    low: float
    high: float
    unit: str
    meaning: str
    scale: float
    """A typical, clearly visible distance from `neutral`: the prior's standard deviation."""
    shape: Literal["scalar", "row", "class"] = "scalar"
    """row: one a beam, top first. class: one a Cityscapes id."""
    fitted: bool = True

    def dims(self, rows: int) -> tuple[int, ...]:
        """Shape of its value on a sensor with so many beams."""
        return {"scalar": (), "row": (rows,), "class": (CLASSES,)}[self.shape]


@dataclass(frozen=True, eq=False)
class Effect:
    """One thing that light, optics, electronics or mounting do and an ideal ray model leaves out.

    Equal and hashed by name, so that it can be a static argument of a jitted function.
    """

    name: str
    stage: str
    title: str
    formula: str
    parameters: dict[str, Parameter]
    channels: tuple[str, ...]
    """Of `CHANNELS`: what it changes."""
    betrays: str
    """The covariates that show it, in words."""
    covariates: tuple[str, ...]
    look_alikes: dict[str, str]
    """Other effects by name, and what measurement tells them apart."""
    source: str
    apply: Callable[[dict[str, Array], Rays, Scan], Rays]
    """Pure; differentiable in the parameters. At neutral parameters the rays come back unchanged."""
    starts: tuple[dict[str, float], ...] = ()
    """Where fits begin if nothing can be learned at neutral; what is not named starts at neutral. Numbers stand
    for every beam or class."""

    def __hash__(self) -> int:
        return hash(self.name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Effect) and other.name == self.name

    def values(self, given: Mapping[str, Any], rows: int) -> dict[str, Array]:
        """Parameters as float32 arrays of their shapes: `given` ones, numbers repeated for vectors, others neutral.

        Raises ValueError for a name that the effect does not have and a vector of another length.
        """
        check_names(self, given)
        result = {}
        for name, parameter in self.parameters.items():
            value = jnp.asarray(given.get(name, parameter.neutral), jnp.float32)
            dims = parameter.dims(rows)
            if value.ndim and value.shape != dims:
                raise ValueError(wrong_length(self, name, value.shape, rows))
            result[name] = jnp.broadcast_to(value, dims)
        return result


def check_names(effect: Effect, given: Mapping[str, Any]) -> None:
    """Raises ValueError for parameters that the effect does not have; it lists those that it has."""
    unknown = sorted(set(given) - set(effect.parameters))
    if unknown:
        raise ValueError(f"{effect.name} has no parameter {', '.join(unknown)}; it has {', '.join(effect.parameters)}")


def check_bounds(effect: Effect, name: str, value: float) -> None:
    """Raises ValueError for a number outside the parameter's bounds."""
    p = effect.parameters[name]
    # Written and read numbers may have gone through float32.
    slack = 1e-6 * max(1.0, abs(p.low), abs(p.high))
    if not math.isfinite(value) or not p.low - slack <= value <= p.high + slack:
        raise ValueError(f"{effect.name}: {name} is {value:g} {p.unit}; it must lie in {p.low:g}..{p.high:g} {p.unit}")


def wrong_length(effect: Effect, name: str, shape: tuple[int, ...], rows: int) -> str:
    """The message for a value whose shape does not fit the sensor."""
    p = effect.parameters[name]
    right = {
        "scalar": "it is one number",
        "row": f"the sensor has {rows} beams: give {rows} numbers, top beam first, or one for all",
        "class": f"give {CLASSES} numbers, one a Cityscapes id 0..{CLASSES - 1}, or one for all",
    }[p.shape]
    return f"{effect.name}: {name} has shape {shape}; {right}"
