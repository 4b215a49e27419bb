"""How far two folders are apart in each channel, in seconds and without a model: a frame after the other is read and
forgotten, so that any number of them takes the memory of one.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.data.polar_frames import open_polar_frames, scene_of
from jaxsim.discover.read.checks import (
    check_no_copies,
    check_no_doubles,
    check_one_grid,
    check_sides,
    check_units,
    constant_intensity,
    levels_of,
    readings_of,
)
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import scene_means
from jaxsim.discover.verdict import Interval
from jaxsim.frame import PolarImage
from jaxsim.progress import counted

DISTANCE_UNITS = {"intensity": "share of full scale", "range": "m", "drop": "share of rays"}
"""Units of the distances."""


class QuickDistances(NamedTuple):
    """What --fast compares."""

    channels: dict[str, Interval]
    frames: int
    """How many frames were compared."""
    measured: int
    """How many frames were measured, of which some may have no simulated partner."""


def quick_distances(simulated: Path, measured: Path) -> QuickDistances:
    """Distances of two folders' frames of one name.

    intensity: mean absolute difference where both sides return. range: median absolute difference there. drop: rays
    on which one side alone returns, as a share of those that hit something in the simulation, 1 at most and where none
    does. Each is the mean over a scene's frames, then over scenes. Raises ValueError where the folders are not of one
    grid, share no frame, have fewer scenes than `Rules.fewest_for_scatter`, hold the same readings, tell one intensity
    everywhere or are not in metres, and where the measured side alone tells angles of incidence.
    """
    ours, theirs = open_polar_frames(simulated), open_polar_frames(measured)
    check_one_grid(ours, theirs)
    names = [name for name in ours.names if name in set(theirs.names)]
    if not names:
        raise ValueError(f"discover: no frame of {simulated} has a partner of its name in {measured}")
    # Scenes count alike, however many frames each has: frames of one street are not independent.
    seen = _Seen()
    table = scene_means(
        (scene_of(name, theirs, ours), frame_distances(*seen.of(name, ours.read(name), theirs.read(name))))
        for name in names
    )
    check_no_copies(ours, theirs, sides=seen.readings, allowed=len(names) - 1)
    check_no_doubles(measured, seen.readings)
    check_sides(simulated, measured, rasters=seen.rasters)
    constant_intensity(*seen.levels)
    if len(table) < RULES.fewest_for_scatter:
        raise ValueError(
            f"discover: {counted(len(table), 'scene')}; a gate needs {RULES.fewest_for_scatter} or more to know what "
            "chance does (frames of one drive share a scene in grid.json)"
        )
    return QuickDistances(distances_of(table), len(names), len(theirs.names))


class _Seen:
    """What is kept of frames that are read one after the other."""

    def __init__(self) -> None:
        self.readings: tuple[dict[str, bytes], dict[str, bytes]] = {}, {}
        self.rasters: tuple[set[str], set[str]] = set(), set()
        self.levels: tuple[list[tuple[float, float]], list[tuple[float, float]]] = [], []

    def of(self, name: str, *sides: tuple[PolarImage, Mapping[str, Any]]) -> list[PolarImage]:
        """The images of both sides. Raises ValueError for those that are not in metres, or dark."""
        for k, (image, rasters) in enumerate(sides):
            # A simulator that renders nothing is a gap, and no wrong unit.
            if np.asarray(image.valid).any():
                check_units(name, image, ("simulated", "measured")[k])
            self.readings[k][name] = readings_of(image)
            self.rasters[k].update(rasters)
            self.levels[k].append(levels_of(image))
        return [image for image, _ in sides]


def distances_of(table: Float[np.ndarray, "s channels"]) -> dict[str, Interval]:
    """The distances of scenes, by channel; one that a single scene shows is none."""
    units = enumerate(DISTANCE_UNITS.items())
    return {channel: Interval.of_scenes(table[:, k], unit, fewest=2) for k, (channel, unit) in units}


def frame_distances(simulated: PolarImage, measured: PolarImage) -> Float[np.ndarray, " channels"]:
    """Intensity, range and drop of one frame; NaN for what no ray shows."""
    ours, theirs = np.asarray(simulated.valid), np.asarray(measured.valid)
    both = ours & theirs
    # Returns of the measured side alone count as well, and may be more than the simulation's.
    # A simulated frame without any return lacks all that the sensor saw: it must count.
    drop = min((ours ^ theirs).sum() / max(ours.sum(), 1), 1.0) if (ours | theirs).any() else np.nan
    if not both.any():
        return np.array([np.nan, np.nan, drop])
    intensity = np.abs(np.asarray(simulated.intensity)[both] - np.asarray(measured.intensity)[both]).mean()
    # The median: rays that met another surface are off by metres.
    range_m = np.median(np.abs(np.asarray(simulated.range_m)[both] - np.asarray(measured.range_m)[both]))
    return np.array([intensity, range_m, drop], np.float64)
