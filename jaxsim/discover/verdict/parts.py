"""The parts of a verdict, in the order in which they are found: what the two sides show before anything is named; what
is named, what was asked beside it and what no effect describes; and what judge scenes, to which nothing was fitted,
show.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS, Parameter
from jaxsim.effects.origin import LookAlike
from jaxsim.effects.region import Region
from jaxsim.metrics.intervals import mean_interval


@dataclass(frozen=True)
class Interval:
    """A value and its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str

    @classmethod
    def of_scenes(
        cls, values: Float[np.ndarray, " s"], unit: str, *, fewest: int = 1, least: float = -np.inf
    ) -> Interval:
        """Gives the mean of the scenes that have a value, its interval by their scatter: NaN where fewer than `fewest`
        have one. It ends at `least` where nothing can be below that."""
        known = values[np.isfinite(values)]
        if len(known) < fewest:
            return cls(np.nan, np.nan, np.nan, unit)
        low, high = mean_interval(known)
        return cls(float(known.mean()), max(low, least), high, unit)

    @classmethod
    def about(cls, value: float, half: float, unit: str) -> Interval:
        """Gives a value with an interval of as much to either side."""
        return cls(float(value), float(value) - half, float(value) + half, unit)

    @classmethod
    def exact(cls, value: float, unit: str) -> Interval:
        """Gives a value that is known, both of whose ends it is."""
        return cls(value, value, value, unit)

    def moved(self, by: float) -> Interval:
        """Gives the same interval about a value that is so much larger."""
        return Interval(self.value + by, self.low + by, self.high + by, self.unit)

    def within(self, of: Parameter) -> Interval:
        """Gives the same interval within a parameter's bounds, in its unit."""
        value, low, high = np.clip([self.value, self.low, self.high], of.low, of.high).tolist()
        return Interval(value, low, high, of.unit)


@dataclass(frozen=True)
class Registered:
    """The sensor's motion from where the simulator has it, by ranges alone."""

    motion: dict[str, Interval]
    """The motion as parameters of `extrinsic_translation`, `extrinsic_rotation` and, where sure,
    `beam_elevation_error`."""
    sure: tuple[str, ...]
    """Which of the three are put in place before anything else is asked."""
    other_moments: bool
    """Whether frames of one name are of different moments; each is then brought to its own place."""
    near: tuple[float, float]
    """Share of the measured points that agree with the simulated surface, as given and as registered: median frame."""
    off_m: tuple[float, float]
    """Median distance between measured and simulated range, as given and as registered."""
    speeds: dict[str, float] | None = None
    """Speed of each drive, m/s, where no speed was given and the frames' own distortion tells it."""


@dataclass(frozen=True)
class Where:
    """A covariate along which the two sides disagree."""

    channel: str
    covariate: str
    p_value: float
    share: float


@dataclass(frozen=True)
class Level:
    """Noise, losses or a lattice of both sides."""

    name: str
    """A name of `levels.MEASURES`."""
    simulated: Interval
    measured: Interval
    missing: Interval
    """What the simulator lacks: of noise, the root of the difference of variances."""
    beyond_usual: bool
    """Whether the simulator lacks more than sensors usually have (`Rules.usual_...`)."""


@dataclass(frozen=True)
class Contrast:
    """How far the sensor follows the simulator's contrast, where its slopes differ by scale: the simulator's error, and
    no effect of the sensor (`model.contrast`)."""

    slopes: dict[str, Interval]
    """Measured over simulated differences of ln I on each of `names.SCALES` and within each class, with all
    that was named in place: 1 where the sensor follows them as they are, 0 where it does not, more than 1 where the
    simulator blurs."""
    gain: Interval
    """What find scenes gained by it, held out, beside what was named without it."""
    p_value: float


@dataclass(frozen=True)
class Sensitivity:
    """What the find scenes could show of an effect (`sensitivity`)."""

    name: str
    size: dict[str, float]
    """The size that was asked, half of a clearly visible one: distance of each parameter from where it does nothing; of
    vectors the root mean square."""
    nats: float
    """What naming could expect to gain at this size, nuisances free, all find scenes together ..."""
    needed: float
    """... and what it must gain, with the numbers that a fit chooses paid for."""
    taken: float
    """Share of what the effect does that nuisances take up."""
    times: float | None
    """Multiple of the size from which on these scenes would show it; None if never."""
    testable: bool
    """Whether they would show it at this size."""
    why: str
    """Why they would not; empty where they would."""
    record: str
    """What to record to tell; empty where it can be told."""

    @property
    def smallest(self) -> dict[str, float]:
        """The size from which on these scenes would show it; empty if never."""
        return {} if self.times is None else {name: self.times * value for name, value in self.size.items()}


@dataclass(frozen=True)
class Fidelity:
    """How far the simulated targets of one kind are from the measured ones (`objects`); per cent of the measured."""

    kind: str
    """A class, of numbered objects; `CLASS, patches` of what has no number."""
    targets: int
    """Their number in all frames."""
    points: Interval
    """Mean absolute error of a target's number of points ..."""
    points_more: Interval
    """... and the mean signed one: above 0 the simulator has more."""
    intensity: Interval
    """The absolute error of its mean intensity."""
    intensity_more: Interval


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
    """Its parameters by name; vectors have one interval a beam or class."""
    does: dict[str, Interval] = field(default_factory=dict)
    """What it changes by channel: the mean of the rays, and between which ends nine of ten lie."""

    @classmethod
    def alone(
        cls, name: str, p_value: float, gain: Interval, *, parameters: Mapping[str, Interval | tuple[Interval, ...]]
    ) -> Named:
        """An effect of the catalogue that nothing looks like here."""
        return cls(name, (), {}, EFFECTS[name].channels, p_value, gain, dict(parameters))

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
    """Why it was not named; empty for what was."""


@dataclass(frozen=True)
class NullDraws:
    """What naming made of measurements in which nothing is missing (`name.null_draws`), one entry a null."""

    effects: tuple[str, ...]
    """The strongest that passed every test but the bar; empty where none did."""
    gains: tuple[float, ...]
    """The gain of each of these, nats per scene; 0 where none passed."""
    free: tuple[float, ...]
    """The gain of each null's strongest free curve, likewise."""
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
    """Where it comes from: `file` and `sha256`, or `package` and `version`."""
    gain: float
    """Gain at the first step, held-out nats per scene."""
    p_value: float
    why_not: str
    """Why it was not named; empty for what was."""
    look_alikes: tuple[LookAlike, ...]
    """Effects of the catalogue that reproduce most of its expectation on these frames, nearest first."""


@dataclass(frozen=True)
class Regime:
    """The part of the recording in which a named effect acts."""

    effect: str
    divides: str
    """What divides: time, tag, azimuth, or scene where nothing that frames say divides their drives."""
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
    """Places along what divides: s, rad, or, where `counted`, numbers of scenes; and the size of the effect at each,
    NaN where nothing tells it; and whether it lies inside."""
    sizes: tuple[float, ...] = ()
    held: tuple[bool, ...] = ()
    counted: bool = False
    """Whether frames say no moment of their own, so that `x` counts scenes."""


@dataclass(frozen=True)
class Unexplained:
    """A dependence that no effect of the catalogue accounts for."""

    channel: str
    covariate: str
    character: str
    """What it looks like: periodic, monotone, step or other."""
    formula: str
    x: tuple[float, ...] = ()
    y: tuple[float, ...] = ()
    band: tuple[float, ...] = ()
    """Half width of the 90 % band of `y`."""
    adds: bool = False
    """Whether `y` is added to the intensity, in its own unit; else it is a change of ln I."""
    along: str = ""
    """What `x` is, where that is a finer look at the covariate (`names.NAMED`); empty where it is itself."""


@dataclass(frozen=True)
class Repeat:
    """A pattern in sensor coordinates that comes back in find and judge scenes, the named effects in place."""

    channel: str
    scale: str
    """What repeats: row, column, cell, parity or wave; `any row`, `any column`, `any cell` where scenes' maps resemble
    each other without a simple pattern."""
    along: str
    """Along what it repeats: row, column, or row x column."""
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


@dataclass(frozen=True)
class Gained:
    """Log-likelihood that one channel of unseen scenes gains by the effects, nats per scene."""

    value: float
    low: float
    """Lower end of the 90 % interval, from the scatter between scenes."""
    high: float
    floor: float
    """What free curves along the named effects' covariates gain with the same data."""
    placebo: float
    """What the scenes gain with the runner-up in place of the named effect."""
    win_rate: float
    """Share of judge scenes that gain."""
    unit: str = "nats per scene"


@dataclass(frozen=True)
class Gap:
    """One channel's distance between simulation and measurement on judge scenes."""

    before: float
    after: float
    low: float
    """Lower end of the 90 % interval of `before - after`, from the scatter between scenes."""
    high: float
    unit: str
    floor: float
    """What free curves along the named effects' covariates reach with the same data."""
    placebo: float
    """The distance that the runner-up reaches in place of the named effect."""
    win_rate: float
    """Share of judge scenes where it shrank."""
    gained: Gained | None = None
    """What the likelihood of the scenes gains; None where none is computed (unpaired)."""

    @property
    def not_worse(self) -> bool:
        """Whether the channel is shown (95 %, one-sided) to be worse by less than `Rules.not_worse_share` of its
        distance."""
        return self.low > -RULES.not_worse_share * self.before
