"""The answer, as plain values: what verdict.json holds and the report draws.

Nothing is computed here; the rooms fill these in, and the report reads nothing else. `Verdict` holds what is said, of
`parts`, in the order in which they are found; `Result` also what is drawn of judge scenes, `CurveLine` and `JudgeFrame`
among it. `names` has what covariates are called.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Real

from jaxsim.discover.verdict.parts import (
    ClosedLaw,
    Contrast,
    Fidelity,
    Gap,
    Interval,
    Level,
    Named,
    NullDraws,
    OwnCandidate,
    Rank,
    Regime,
    Registered,
    Repeat,
    Sensitivity,
    Unexplained,
    Where,
)
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.learned import Learned
from jaxsim.effects.region import Region
from jaxsim.files import write_text
from jaxsim.frame import PolarGrid, in_notebook

VERDICT = "verdict.json"
"""The answer's file, the last that is written."""


@dataclass(frozen=True)
class InPlace:
    """What a control says that the simulator lacks by itself, and was in place from the start."""

    names: tuple[str, ...]
    """Its effects and learned laws; empty where the control found none."""
    contrast_off: bool
    """Whether the sensor did not follow the simulator's contrast, which was left free here."""


@dataclass(frozen=True)
class OddFrame:
    """A frame that the answer serves ill."""

    name: str
    scene: str
    nats: float
    """What it gains by the answer, all channels together."""


@dataclass(frozen=True)
class EveryFrame:
    """What the answer does on all frames that were not read for it, because so many do not fit into memory."""

    frames: int
    scenes: int
    unseen: int
    """How many of these scenes had no frame that helped to find or to fit anything."""
    gained: dict[str, Interval]
    """Log-likelihood by channel, nats a frame, mean over scenes."""
    gained_unseen: dict[str, Interval]
    """The same log-likelihood of the unseen scenes alone."""
    before: dict[str, Interval]
    """Mean errors by channel, in the units of the gap, without the answer."""
    after: dict[str, Interval]
    """The same errors with the answer in place."""
    worst: tuple[OddFrame, ...]
    """The frames that gain least, the least first."""


@dataclass(frozen=True)
class Verdict:
    """What `discover` answers."""

    verdict: str
    """Which answer it is: named, none or not_in_catalogue."""
    effects: tuple[Named, ...]
    where: tuple[Where, ...]
    unexplained: Unexplained | None
    gap: dict[str, Gap]
    closure: Interval | None
    find: tuple[str, ...]
    judge: tuple[str, ...]
    sha256: str
    frames: int
    seconds: float
    moved: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Noise scales and rates before and after the effects were added; ln of the overall `gain` and of each class's
    reflectance over the simulator's (`class ID`); and, where several were added, each one's parameters
    (`EFFECT.PARAMETER`) as fitted when it was added, and with the others in place."""
    ranking: tuple[Rank, ...] = ()
    nulls: NullDraws | None = None
    """What nulls of these very data gained; None where the bar was not set on them."""
    levels: tuple[Level, ...] = ()
    """Noise, losses and lattices of both sides; empty where frames are not compared one by one (unpaired)."""
    contrast: Contrast | None = None
    """How far the sensor follows the simulator's contrast; None where it does, and where that was not asked."""
    control: InPlace | None = None
    """What a control put in place; None where none was given."""
    objects: tuple[Fidelity, ...] = ()
    """Points and intensities a target; empty where the simulated frames have no classes, and unpaired."""
    own: tuple[OwnCandidate, ...] = ()
    """Candidates that are no part of the catalogue."""
    learned: tuple[Learned, ...] = ()
    """What no effect describes, as it was added to the sensor model."""
    law: ClosedLaw | None = None
    """A formula for it."""
    repeats: tuple[Repeat, ...] = ()
    """What repeats in sensor coordinates and no named effect explains, most certain first."""
    unconfirmed: tuple[Named, ...] = ()
    """Effects that were found and by which the judge scenes do not gain: they are not named."""
    registered: Registered | None = None
    """Where the sensor stood; None where frames are not compared one by one (unpaired)."""
    every_frame: EveryFrame | None = None
    """The answer on the frames that were not read; None where all were, and unpaired."""
    unrelated: bool = False
    """Whether the sides' intensities have no relation beyond chance, so that no effect on them was asked."""
    regimes: tuple[Regime, ...] = ()
    """Effects that act in a part of the recording alone."""
    sensitivity: tuple[Sensitivity, ...] = ()
    """What the find scenes could show of every candidate, least first; empty where frames are not compared one by one
    (unpaired)."""
    notes: tuple[str, ...] = ()
    """What a reader must know: sectors instead of scenes, effects that could not be told apart unpaired ..."""

    @property
    def changed(self) -> bool:
        """Whether the gap has anything in place on its second side: effects, confirmed or not, or a learned law."""
        return bool(self.effects or self.learned or self.unconfirmed)

    @property
    def not_testable(self) -> tuple[Sensitivity, ...]:
        """What the find scenes could not show at the size that was asked, and did not show at another."""
        named = {effect.name for effect in self.effects}
        return tuple(shown for shown in self.sensitivity if not shown.testable and shown.name not in named)

    def judged_nats(self, *channels: str) -> float:
        """Tells what judge scenes gain in these channels, in their mean, with all in place that was found: nats a
        scene."""
        gains = [self.gap[channel].gained for channel in channels if channel in self.gap]
        return sum(one.value for one in gains if one is not None)

    def to_json(self) -> dict[str, Any]:
        """Gives the content of verdict.json (docs/verdict.md)."""
        content = plain(self)
        # A channel that was not compared (unpaired: all but the intensity) is null.
        gap: dict[str, Any] = {name: content["gap"].get(name) for name in ("intensity", "range", "drop")}
        for name, one in self.gap.items():
            gap[name]["not_worse"] = one.not_worse
        gap["closure"] = content.pop("closure")
        splits = {name: content.pop(name) for name in ("find", "judge", "sha256")}
        hidden = [{"name": one.name, "why": one.why, "record": one.record} for one in self.not_testable]
        content["not_testable"] = hidden
        for shown, one in zip(content["sensitivity"], self.sensitivity, strict=True):
            shown["smallest"] = plain(one.smallest)
        return content | {"gap": gap, "splits": splits, "seconds": round(self.seconds, 2)}

    def save(self, folder: Path) -> Path:
        """Writes verdict.json."""
        return write_text(Path(folder) / VERDICT, json.dumps(self.to_json(), indent=1))


def plain(value: Any) -> Any:
    """Gives a part of a verdict as JSON has it: six digits, and null for what is not finite."""
    if isinstance(value, Region):
        return value.to_json()
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, tuple) and value and all(isinstance(one, Interval) for one in value):
        # A vector: one list for each part of its intervals.
        parts = {name: [plain(getattr(one, name)) for one in value] for name in ("value", "low", "high")}
        return {**parts, "unit": value[0].unit}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, (np.floating, float)):
        return float(f"{float(value):.6g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


@dataclass(frozen=True)
class CurveLine:
    """Mean residual along a covariate on judge scenes, before and after the effects were added."""

    channel: str
    covariate: str
    unit: str
    """Unit of the residual: nats of ln I, m of range, share of rays lost."""
    x: Float[np.ndarray, " k"]
    before: Float[np.ndarray, " k"]
    after: Float[np.ndarray, " k"]
    band: Float[np.ndarray, " k"]
    """Half width of the 90 % interval of `before`, from the scatter between scenes; NaN where fewer than two have a
    value."""
    spread: bool = False
    """Whether it is not the mean of the residuals but their spread over the expected one, less 1."""
    edges: Float[np.ndarray, " k+1"] | None = None
    """Edges of the groups of rays that the points are means of: each group holds what lies from one to below the next.
    None where it is not kept (unpaired)."""

    def group_of(self, values: Real[np.ndarray, "*n"]) -> Int[np.ndarray, "*n"]:
        """Gives the group of each value of the covariate; -1 for all where the edges are not kept."""
        if self.edges is None:
            return np.full(np.shape(values), -1)
        return np.clip(np.searchsorted(self.edges, values, side="right") - 1, 0, len(self.x) - 1)


@dataclass(frozen=True)
class JudgeFrame:
    """One frame of a judge scene, ray by ray (n rays)."""

    name: str
    scene: str
    """Its scene; empty where it holds several, sectors of a drive."""
    row: Int[np.ndarray, " n"]
    column: Int[np.ndarray, " n"]
    range_m: Float[np.ndarray, " n"]
    """Measured range; of rays that were lost, the simulated one."""
    returned: Bool[np.ndarray, " n"]
    before: dict[str, Float[np.ndarray, " n"]]
    """Residuals of each channel in its own unit, NaN where it is not compared."""
    after: dict[str, Float[np.ndarray, " n"]]
    groups: tuple[Int[np.ndarray, " n"], ...] = ()
    """For each curve of the result, the group of each ray, -1 where it is in none."""
    time_s: float = 0.0
    """Time since the recording's first frame; 0 for all where frames say no time."""


@dataclass(frozen=True)
class Judged:
    """Gaps by channel, the closure, and what a report draws (`Result` says what maps and curves hold)."""

    gap: dict[str, Gap]
    closure: Interval | None
    maps_before: dict[str, Float[np.ndarray, "r c"]]
    maps_after: dict[str, Float[np.ndarray, "r c"]]
    curves: tuple[CurveLine, ...]
    frames: tuple[JudgeFrame, ...] = ()


@dataclass(frozen=True)
class Result:
    """The answer and its evidence. Maps are mean residuals of judge frames on the polar grid (rows, columns), NaN
    where nothing was compared: measured minus simulated ln I (nats), range (m), and share of rays lost minus
    expected."""

    verdict: Verdict
    effects_model: SensorModel
    grid: PolarGrid
    maps_before: dict[str, Float[np.ndarray, "r c"]]
    maps_after: dict[str, Float[np.ndarray, "r c"]]
    curves: tuple[CurveLine, ...]
    candidates: tuple[Any, ...] = ()
    """The whole first ranking (`name.candidates.Candidate`) with its fits, for who wants to choose by another rule."""
    frames: tuple[JudgeFrame, ...] = ()
    """A few judge frames ray by ray; empty where frames are not compared one by one (unpaired)."""

    def _repr_html_(self) -> str:
        return in_notebook(self)
