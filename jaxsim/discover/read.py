"""Two folders of polar frames to one comparison: the frames that both have, checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jaxsim.data.polar_frames import frame_names, read_frame, read_grid
from jaxsim.discover.evidence import Measured
from jaxsim.effects.rays import Scan
from jaxsim.effects.scan import scan_of
from jaxsim.frame import PolarGrid, PolarImage


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


def same_grid(ours: PolarGrid, theirs: PolarGrid, simulated: Path, measured: Path) -> None:
    """Raises ValueError where two folders' grids differ."""
    for what in ("azimuth_rad", "elevation_rad", "origin_m"):
        a, b = np.asarray(getattr(ours, what)), np.asarray(getattr(theirs, what))
        if a.shape != b.shape or not np.allclose(a, b, atol=1e-4):
            detail = f"{a.size} and {b.size} values" if a.shape != b.shape else f"up to {np.abs(a - b).max():.4g} apart"
            raise ValueError(
                f"discover: the grids of {simulated} and {measured} differ in {what} ({detail}); simulate on the "
                "measured sensor's grid.json"
            )


def read_comparison(simulated: Path, measured: Path) -> Comparison:
    """Reads the frames that two folders of polar frames share.

    Raises ValueError where the grids differ, no names are shared, values have wrong units, frames are empty, or
    both folders hold the same readings.
    """
    simulated, measured = Path(simulated), Path(measured)
    grid, about = read_grid(simulated)
    other, about_measured = read_grid(measured)
    same_grid(grid, other, simulated, measured)
    here, there = frame_names(simulated), frame_names(measured)
    names = sorted(set(here) & set(there))
    for folder, own in ((simulated, here), (measured, there)):
        if not own:
            raise ValueError(f"discover: no frames (NAME.npz) in {folder}")
    if not names:
        raise ValueError(
            f"discover: no frame of {simulated} ({', '.join(here[:3])} ...) has the name of one of {measured} "
            f"({', '.join(there[:3])} ...); frames of the same name are compared"
        )
    images, extra, sensed = [], [], []
    for name in names:
        image, more = read_frame(simulated, name)
        images.append(image)
        extra.append(more)
        sensed.append(read_frame(measured, name)[0])
        if image.valid.shape != sensed[-1].valid.shape or image.valid.shape != (
            len(grid.elevation_rad),
            len(grid.azimuth_rad),
        ):
            raise ValueError(
                f"discover: {name} is {image.valid.shape} simulated and {sensed[-1].valid.shape} measured; the grid "
                f"has {len(grid.elevation_rad)} rows and {len(grid.azimuth_rad)} columns"
            )
        plausible(name, image, "simulated")
        plausible(name, sensed[-1], "measured")
    if all(
        np.array_equal(a.range_m, b.range_m) and np.array_equal(a.intensity, b.intensity)
        for a, b in zip(images, sensed, strict=True)
    ):
        raise ValueError(
            f"discover: {simulated} and {measured} hold the same readings; compare a simulation with a sensor"
        )
    alone = len(set(here) ^ set(there))
    notes = (f"{alone} frames have no partner of the same name in the other folder and are left out",) if alone else ()
    facts = []
    for name in names:
        ours, theirs = about.get(name, {}), about_measured.get(name, {})
        if "scene" in ours and "scene" in theirs and ours["scene"] != theirs["scene"]:
            raise ValueError(
                f"discover: {name} is of scene {ours['scene']!r} in {simulated}, of {theirs['scene']!r} in {measured}; "
                "frames of the same name must be a pair"
            )
        facts.append({**theirs, **ours})
    return Comparison(
        scan=scan_of(grid, images, extra, facts),
        measured=Measured(
            *(np.stack([getattr(m, part) for m in sensed]) for part in ("range_m", "intensity", "valid"))
        ),
        names=tuple(names),
        scenes=tuple(str(fact.get("scene", name)) for name, fact in zip(names, facts, strict=True)),
        notes=notes,
    )


def plausible(name: str, image: PolarImage, side: str) -> None:
    """Raises ValueError for a frame that is empty, dark, or not in metres."""
    valid = np.asarray(image.valid)
    range_m, intensity = np.asarray(image.range_m)[valid], np.asarray(image.intensity)[valid]
    if valid.mean() < 0.01:
        raise ValueError(
            f"discover: {side} frame {name} is empty: {valid.sum()} of {valid.size} rays returned; leave it out"
        )
    if np.median(range_m) > 500:
        raise ValueError(
            f"discover: {side} frame {name} has a median range of {np.median(range_m):.0f}; ranges are metres: divide "
            "millimetres by 1000, centimetres by 100"
        )
    if not intensity.any():
        raise ValueError(f"discover: {side} frame {name} has intensity 0 everywhere; there is nothing to compare")
