"""What the two sides show before anything is named: where the sensor stood, where they disagree, how much each
scatters, and what they could show at all."""

from __future__ import annotations

from dataclasses import dataclass

from jaxsim.discover.verdict.values import Interval


@dataclass(frozen=True)
class Registered:
    """The sensor's motion from where the simulator has it, by ranges alone."""

    motion: dict[str, Interval]
    """The motion as parameters of `extrinsic_translation`, `extrinsic_rotation` and, where sure,
    `beam_elevation_error`."""
    sure: tuple[str, ...]
    """Those of the three that are put in place before anything else is asked."""
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
class Sensitivity:
    """What the find scenes could show of an effect (`sensitivity`)."""

    name: str
    size: dict[str, float]
    """That was asked, half of a clearly visible one: distance of each parameter from where it does nothing; of
    vectors the root mean square."""
    nats: float
    """That naming could expect to gain at this size, nuisances free, all find scenes together ..."""
    needed: float
    """... and what it must, with the numbers that a fit chooses paid for."""
    taken: float
    """Share of what the effect does that nuisances take up."""
    times: float | None
    """Multiple of the size from which on these scenes would show it; None if never."""
    testable: bool
    """Whether they would show it at this size."""
    why: str
    """Why not; empty where they would."""
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
    """In all frames."""
    points: Interval
    """Mean absolute error of a target's number of points ..."""
    points_more: Interval
    """... and the mean signed one: above 0 the simulator has more."""
    intensity: Interval
    """The same of its mean intensity."""
    intensity_more: Interval
