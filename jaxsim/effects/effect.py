"""What a law is (parameters and one pure function on rays), and what the catalogue says of one: an `Effect`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import jax.numpy as jnp

from jaxsim.effects.rays import Array, Rays
from jaxsim.frame import CLASSES

STAGES = ("geometry", "surface", "path", "receiver", "detection", "ranging")
"""Stages in physical order: effects of an earlier stage act first."""
CHANNELS = ("intensity", "range", "drop")
COVARIATE_NAMES = (
    *("range", "incidence", "height", "row", "column", "azimuth", "class", "instance", "power", "intensity", "step"),
    *("time", "frame", "speed", "rgb", "heading"),
)
"""What residuals can depend on: `height` is that over the sensor, `step` the depth step to a neighbour, `time` the time
within the scan."""


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
    """A typical, clearly visible distance from `neutral`. The prior's standard deviation is `scale` for each entry of a
    vector and three times it for a number (`discover.model.parameters`), unless it is `sparse`."""
    shape: Literal["scalar", "row", "class"] = "scalar"
    """row: one a beam, top first. class: one a Cityscapes id."""
    to_fit: bool = True
    """Whether fits estimate it; given once for all if not."""
    sparse: bool = False
    """Whether most entries of a vector are neutral, and a few are far off: dead beams are few."""

    def dims(self, rows: int) -> tuple[int, ...]:
        """Shape of its value on a sensor with so many beams."""
        return {"scalar": (), "row": (rows,), "class": (CLASSES,)}[self.shape]


@dataclass(frozen=True, eq=False, kw_only=True)
class Law:
    """What becomes of rays, as a pure function of a few parameters.

    Laws are equal and hashed by name, so that they can be static arguments of jitted functions; two laws must not
    share a name.
    """

    name: str
    parameters: dict[str, Parameter]
    channels: tuple[str, ...]
    """The channels, of `CHANNELS`, that it changes."""
    apply: Callable[[dict[str, Array], Rays], Rays]
    """Gives the rays after it; differentiable in the parameters. At neutral parameters they come back unchanged."""
    casts: int = 0
    """How many times the surfaces are looked up that its rays meet (`recast`); 0 of a law that turns and moves no
    ray."""
    covariates: tuple[str, ...] = ()
    """The covariates, of `COVARIATE_NAMES`, that residuals depend on where it acts."""
    clutter: bool = False
    """Whether it puts false returns before surfaces; the likelihood has that component only where one law does."""
    of_recording: bool = False
    """Whether it has one number for all rays of a recording (a step, a top), which is read off them: it acts in no part
    alone."""
    of_mounting: bool = False
    """Whether it puts the whole sensor to another place, alike in all frames."""
    around_bright: bool = False
    """Whether it acts around what the simulator has bright."""
    needs: Literal["", "time", "speed", "heading"] = ""
    """What frames must say of themselves for it to act."""
    starts: tuple[dict[str, Any], ...] = ()
    """Parameters where fits begin if nothing can be learned at neutral; what is not named starts at neutral. Numbers
    stand for every beam or class."""

    @property
    def plain_name(self) -> str:
        """The name of the effect that acts in a part alone (`region.within`), else its own."""
        return self.name.partition("@")[0]

    def __hash__(self) -> int:
        return hash(self.name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Law) and other.name == self.name

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
                raise ValueError(wrong_length(self, name, value.shape, rows=rows))
            result[name] = jnp.broadcast_to(value, dims)
        return result


@dataclass(frozen=True, eq=False, kw_only=True)
class Effect(Law):
    """A law that light, optics, electronics or mounting follow and an ideal ray model leaves out, with its row of the
    catalogue."""

    stage: str
    """The stage, of `STAGES`, at which it acts."""
    title: str
    formula: str
    opposite: str = ""
    """What it is, in words, where its first parameter lies below neutral and the title says something else."""
    signature: str = ""
    """How its covariates show it, in words; an effect of one's own need not say."""
    look_alikes: dict[str, str] = field(default_factory=dict)
    """Other effects by name, and what measurement tells them apart; computed for an effect of one's own."""
    source: str = ""
    """The publication of the formula, or of the observation behind it; an effect of one's own need not say."""


def check_names(law: Law, given: Mapping[str, Any]) -> None:
    """Raises ValueError for parameters that the effect does not have; it lists those that it has."""
    unknown = sorted(set(given) - set(law.parameters))
    if unknown:
        raise ValueError(f"{law.name} has no parameter {', '.join(unknown)}; it has {', '.join(law.parameters)}")


def check_bounds(law: Law, name: str, value: float) -> None:
    """Raises ValueError for a number outside the parameter's bounds."""
    p = law.parameters[name]
    # Written and read numbers may have gone through float32.
    slack = 1e-6 * max(1.0, abs(p.low), abs(p.high))
    if not math.isfinite(value) or not p.low - slack <= value <= p.high + slack:
        unit = f" {p.unit}" if p.unit else ""
        raise ValueError(f"{law.name}: {name} is {value:g}{unit}; it must lie in {p.low:g}..{p.high:g}{unit}")


def wrong_length(law: Law, name: str, shape: tuple[int, ...], *, rows: int) -> str:
    """The message for a value whose shape does not fit the sensor."""
    p = law.parameters[name]
    right = {
        "scalar": "it is one number",
        "row": f"the sensor has {rows} beams: give {rows} numbers, top beam first, or one for all",
        "class": f"give {CLASSES} numbers, one a Cityscapes id 0..{CLASSES - 1}, or one for all",
    }[p.shape]
    return f"{law.name}: {name} has shape {shape}; {right}"
