"""What is named, what was asked beside it, and what no effect describes."""

from __future__ import annotations

from dataclasses import dataclass

from jaxsim.discover.verdict.values import Interval
from jaxsim.effects.origin import LookAlike
from jaxsim.effects.region import Region


@dataclass(frozen=True)
class Named:
    """An effect that the answer names."""

    name: str
    look_alikes: tuple[str, ...]
    """Effects that these data cannot tell from it."""
    tell_apart: dict[str, str]
    """The measurement that would tell each of them apart."""
    channels: tuple[str, ...]
    p_value: float
    gain: Interval
    """Held-out nats a scene over the model without it."""
    parameters: dict[str, Interval | tuple[Interval, ...]]
    """Vectors as one interval a beam or class."""

    @property
    def values(self) -> dict[str, float | tuple[float, ...]]:
        """The parameters without their intervals, as sensor.json holds them."""
        return {
            name: one.value if isinstance(one, Interval) else tuple(part.value for part in one)
            for name, one in self.parameters.items()
        }


@dataclass(frozen=True)
class Rank:
    """A candidate of the first step, for the report."""

    name: str
    gain: float
    p_value: float
    bar: float
    why_not: str
    """Empty for what was named."""


@dataclass(frozen=True)
class Nulls:
    """What naming made of measurements in which nothing is missing (`name.nulls`), one entry a null."""

    effects: tuple[str, ...]
    """The strongest that passed every test but the bar; empty where none did."""
    gains: tuple[float, ...]
    """Its gain, nats per scene; 0 where none passed."""
    free: tuple[float, ...]
    """The strongest free curve's gain likewise."""
    answered: int
    """Nulls of which something would have been said with the standing bar."""
    bar: float
    """The bar that an effect must pass here, nats per scene: the standing one, or the largest of `gains`."""
    free_bar: float


@dataclass(frozen=True)
class OwnCandidate:
    """An effect of one's own among the candidates."""

    name: str
    origin: dict[str, str]
    """`file` and `sha256`, or `package` and `version`."""
    gain: float
    """Gain at the first step, held-out nats per scene."""
    p_value: float
    why_not: str
    """Empty for what was named."""
    look_alikes: tuple[LookAlike, ...]
    """Effects of the catalogue that reproduce most of its expectation on these frames, nearest first."""


@dataclass(frozen=True)
class Regime:
    """The part of the recording in which a named effect acts."""

    effect: str
    divides: str
    """time, tag, azimuth, or scene where nothing that frames say divides their drives."""
    where: Region
    share: float
    """Share of all frames' columns that it holds."""
    inside: Interval
    """Size of the effect inside, in units of the fit there; its interval is the scatter between scenes."""
    outside: Interval
    """Size outside in the same unit: 0 where it does nothing."""
    p_value: float
    """Probability that some region of the question is so different by chance."""
    q_value: float
    """Rate of false discoveries over all questions asked."""
    judge_nats: float
    """What judge scenes gain by it over the effect everywhere."""
    applied: bool
    """Whether simulated frames say where it acts."""
    x: tuple[float, ...] = ()
    """Places along what divides: s, rad, or numbers of scenes; and the size of the effect, were it fitted everywhere,
    at each, NaN where nothing tells it; and whether it lies inside."""
    sizes: tuple[float, ...] = ()
    held: tuple[bool, ...] = ()


@dataclass(frozen=True)
class Unexplained:
    """A dependence that no effect of the catalogue accounts for."""

    channel: str
    covariate: str
    character: str
    """periodic, monotone, step or other."""
    formula: str
    x: tuple[float, ...] = ()
    y: tuple[float, ...] = ()
    band: tuple[float, ...] = ()
    """Half width of the 90 % band of `y`."""


@dataclass(frozen=True)
class Repeat:
    """A pattern in sensor coordinates that comes back in find and judge scenes, the named effects in place."""

    channel: str
    scale: str
    """row, column, cell, parity or wave; `any row`, `any column`, `any cell` where scenes' maps resemble each other
    without a simple pattern."""
    along: str
    """row, column, or row x column."""
    place: str
    """The place in words: which rows and columns, or how many periods over the image."""
    period: float | None
    """Period of a wave or parity: columns, or rows where it runs along these alone."""
    formula: str
    size: Interval
    """Height of the pattern in find and judge scenes: nats of ln I, m, share of rays lost; of parities the difference
    between odd and even; of `any ...` the root mean square."""
    p_value: float
    """Probability by chance on find scenes, of all scales, places and channels together."""
    p_judge: float
    """Probability by chance on judge scenes, of this pattern."""


@dataclass(frozen=True)
class ClosedLaw:
    """A closed formula for a learned law (`law.search`)."""

    channel: str
    covariates: tuple[str, ...]
    """Variables of the formula, by the names and in the units of `variables`."""
    formula: str
    """The formula with its numbers, for people."""
    expression: str
    """The formula with the names of its parameters, for programs."""
    parameters: dict[str, Interval]
    limits: dict[str, tuple[float, float]]
    """Least and most of each variable that was seen; the formula holds between them."""
    nodes: int
    held_out_nats: float
    """What it gains over a level alone on groups of scenes that its fit has not seen."""
    share: float
    """Share of the learned curve's variation that it tells."""
