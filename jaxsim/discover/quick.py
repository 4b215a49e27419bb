"""How far simulated frames are from measured ones, in seconds and without a model: for a gate at every commit.

A frame after the other is read and forgotten, so that any number of them takes the memory of one. The whole answer,
with names for what is missing, is `discover`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxsim.data.polar_frames import PolarFrames, open_polar_frames
from jaxsim.discover.checks import check_one_grid
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import Interval
from jaxsim.frame import PolarImage
from jaxsim.metrics.intervals import mean_interval

CHANNELS = {"intensity": "share of full scale", "range": "m", "drop": "share of rays"}
"""Units of the distances."""


def quick_distances(simulated: Path, measured: Path) -> dict[str, Interval]:
    """Distances of two folders' frames of one name.

    intensity: mean absolute difference where both sides return. range: median absolute difference there. drop: share
    of the rays that hit something in the simulation on which one side alone returns. Each is the mean over a scene's
    frames, then over scenes. Raises ValueError where the folders are not of one grid, share no frame, or have fewer
    than `Rules.gate_fewest_scenes`.
    """
    ours, theirs = open_polar_frames(simulated), open_polar_frames(measured)
    check_one_grid(ours, theirs)
    names = [name for name in ours.names if name in set(theirs.names)]
    if not names:
        raise ValueError(f"discover: no frame of {simulated} has a partner of its name in {measured}")
    by_scene: dict[str, list[np.ndarray]] = {}
    for name in names:
        row = frame_distances(ours.read(name)[0], theirs.read(name)[0])
        by_scene.setdefault(_scene(theirs, ours, name), []).append(row)
    if len(by_scene) < RULES.gate_fewest_scenes:
        raise ValueError(
            f"discover: {len(by_scene)} scenes; a gate needs {RULES.gate_fewest_scenes} or more to know what chance "
            "does (frames of one drive share a scene in grid.json)"
        )
    table = np.array([np.nanmean(rows, axis=0) for rows in by_scene.values()])
    return {channel: distance_of(table[:, k], unit) for k, (channel, unit) in enumerate(CHANNELS.items())}


def frame_distances(simulated: PolarImage, measured: PolarImage) -> Float[np.ndarray, " channels"]:
    """Intensity, range and drop of one frame; NaN for what no ray shows."""
    ours, theirs = np.asarray(simulated.valid), np.asarray(measured.valid)
    both = ours & theirs
    if not both.any():
        return np.array([np.nan, np.nan, 1.0 if ours.any() else np.nan])
    intensity = np.abs(np.asarray(simulated.intensity)[both] - np.asarray(measured.intensity)[both]).mean()
    range_m = np.median(np.abs(np.asarray(simulated.range_m)[both] - np.asarray(measured.range_m)[both]))
    return np.array([intensity, range_m, (ours ^ theirs).sum() / max(int(ours.sum()), 1)], np.float64)


def distance_of(scenes: Float[np.ndarray, " s"], unit: str) -> Interval:
    """The mean over the scenes that have a value."""
    known = scenes[np.isfinite(scenes)]
    low, high = mean_interval(known)
    return Interval(float(known.mean()) if len(known) > 1 else float("nan"), low, high, unit)


def _scene(side: PolarFrames, other: PolarFrames, name: str) -> str:
    """The scene that either side gives a frame; its own name where neither does."""
    return str(side.about.get(name, {}).get("scene", other.about.get(name, {}).get("scene", name)))
