"""Two folders of polar frames to one comparison: the frames that both have, checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.data.polar_frames import PolarFrames, open_polar_frames
from jaxsim.discover.model.evidence import Measured
from jaxsim.discover.pairing import check_pairs
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import Scan
from jaxsim.effects.scan import scan_of
from jaxsim.frame import PolarImage
from jaxsim.geometry import grid_difference

RASTERS = ("semantic", "instance", "incidence", "rgb", "time")
"""What the simulated side may have besides range and intensity."""


@dataclass(frozen=True)
class Comparison:
    """Simulated and measured frames of the same names on one grid."""

    scan: Scan
    measured: Measured
    names: tuple[str, ...]
    scenes: tuple[str, ...]
    """The scene of each frame."""
    notes: tuple[str, ...] = ()
    """What a reader of the verdict must know of the folders."""


def read_comparison(simulated: Path, measured: Path) -> Comparison:
    """Reads the frames that two folders of polar frames share.

    Raises ValueError where the grids differ, no names are shared, values have wrong units, frames are empty or do not
    show the same street, rasters are given for some frames only, or both folders hold the same readings.
    """
    simulated, measured = Path(simulated), Path(measured)
    predicted = open_polar_frames(simulated)
    recorded = open_polar_frames(measured)
    grid = predicted.grid
    check_one_grid(predicted, recorded)
    names = sorted({*predicted.names} & {*recorded.names})
    if not names:
        raise ValueError(
            f"discover: no frame of {simulated} ({', '.join(predicted.names[:3])} ...) has the name of one of "
            f"{measured} ({', '.join(recorded.names[:3])} ...); frames of the same name are compared"
        )
    images: list[PolarImage] = []
    sensed: list[PolarImage] = []
    extra: list[Mapping[str, np.ndarray]] = []
    for name in names:
        image, rasters = predicted.read(name)
        images.append(image)
        extra.append(rasters)
        sensed.append(recorded.read(name)[0])
        plausible(name, image, "simulated")
        plausible(name, sensed[-1], "measured")
    if all(
        np.array_equal(a.range_m, b.range_m) and np.array_equal(a.intensity, b.intensity)
        for a, b in zip(images, sensed, strict=True)
    ):
        raise ValueError(
            f"discover: {simulated} and {measured} hold the same readings; compare a simulation with a sensor"
        )
    check_pairs(names, images, sensed)
    all_or_none(simulated, names, extra)
    notes = [*unpartnered(predicted.names, recorded.names), *constant_intensity(images, sensed)]
    facts = []
    for name in names:
        ours = predicted.about.get(name, {})
        theirs = recorded.about.get(name, {})
        if "scene" in ours and "scene" in theirs and ours["scene"] != theirs["scene"]:
            raise ValueError(
                f"discover: {name} is of scene {ours['scene']!r} in {simulated}, of {theirs['scene']!r} in {measured}; "
                "frames of the same name must be a pair"
            )
        facts.append({**theirs, **ours})
    return Comparison(
        scan=scan_of(grid, images, extra, about=facts),
        measured=Measured(
            *(np.stack([getattr(m, part) for m in sensed]) for part in ("range_m", "intensity", "valid"))
        ),
        names=tuple(names),
        scenes=tuple(str(fact.get("scene", name)) for name, fact in zip(names, facts, strict=True)),
        notes=(*notes, *sceneless(names, facts)),
    )


def check_one_grid(simulated: PolarFrames, measured: PolarFrames) -> None:
    """Raises ValueError where two folders' grids differ."""
    if difference := grid_difference(simulated.grid, measured.grid):
        raise ValueError(
            f"discover: the grids of {simulated.folder} and {measured.folder} differ in {difference}; simulate on the "
            "measured sensor's grid.json"
        )


def all_or_none(folder: Path, names: Sequence[str], extra: Sequence[Mapping[str, np.ndarray]]) -> None:
    """Raises ValueError where some frames of a folder have a raster that others lack."""
    for key in RASTERS:
        lacking = [name for name, rasters in zip(names, extra, strict=True) if key not in rasters]
        if 0 < len(lacking) < len(names):
            raise ValueError(
                f"discover: {len(lacking)} of {len(names)} frames of {folder} lack {key} ({', '.join(lacking[:3])}"
                f"{' ...' if len(lacking) > 3 else ''}) and the others have it; give it for all or none"
            )


def unpartnered(simulated: Sequence[str], measured: Sequence[str]) -> list[str]:
    """A note on frames that only one folder has."""
    alone = len({*simulated} ^ {*measured})
    return [f"{alone} frames have no partner of the same name in the other folder and are left out"] if alone else []


def constant_intensity(simulated: Sequence[PolarImage], measured: Sequence[PolarImage]) -> list[str]:
    """A note where the simulated intensity is the same everywhere. Raises ValueError where the measured one is."""
    least, most = _levels(measured)
    if least == most:
        raise ValueError(
            f"discover: measured intensity is {least:g} everywhere; a sensor that reports none cannot be "
            "compared: give what it measures (reflectivity, signal or intensity of its driver)"
        )
    least, most = _levels(simulated)
    if least == most:
        return [
            f"simulated intensity is {least:g} everywhere: what differs between surfaces counts as noise or as "
            "reflectances, and effects on intensity are told less surely"
        ]
    return []


def _levels(side: Sequence[PolarImage]) -> tuple[float, float]:
    """Least and largest intensity of all returns."""
    values = [np.asarray(image.intensity)[np.asarray(image.valid)] for image in side]
    return min(float(v.min()) for v in values), max(float(v.max()) for v in values)


def sceneless(names: Sequence[str], facts: Sequence[Mapping[str, Any]]) -> list[str]:
    """A note on frames of which grid.json names no scene: each counts as one, though they may be one drive's."""
    without = [fact for fact in facts if "scene" not in fact]
    if not without:
        return []
    note = (
        f"{len(without)} of {len(names)} frames have no scene in grid.json and count as a drive each: if they are of "
        "one drive they are not independent, and p-values and intervals are too small; give each frame its scene"
    )
    times = np.sort([float(fact["time"]) for fact in without if "time" in fact])
    step = float(np.median(np.diff(times))) if len(times) > 1 else np.inf
    if step < RULES.consecutive_s:
        note += (
            f". Their times are {step:g} s apart: consecutive frames of one drive, it seems. Do not trust p-values and "
            "intervals of this answer"
        )
    return [note]


def plausible(name: str, image: PolarImage, side: str) -> None:
    """Raises ValueError for a frame that is empty, dark, or not in metres."""
    valid = np.asarray(image.valid)
    range_m, intensity = np.asarray(image.range_m)[valid], np.asarray(image.intensity)[valid]
    if valid.mean() < RULES.fewest_returns:
        raise ValueError(
            f"discover: {side} frame {name} is empty: {valid.sum()} of {valid.size} rays returned; leave it out"
        )
    if np.median(range_m) > RULES.farthest_m:
        raise ValueError(
            f"discover: {side} frame {name} has a median range of {np.median(range_m):.0f}; ranges are metres: divide "
            "millimetres by 1000, centimetres by 100"
        )
    if np.median(range_m) < RULES.nearest_m:
        raise ValueError(
            f"discover: {side} frame {name} has a median range of {np.median(range_m):.3g}; ranges are metres: "
            "multiply kilometres by 1000"
        )
    if not intensity.any():
        raise ValueError(f"discover: {side} frame {name} has intensity 0 everywhere; there is nothing to compare")
