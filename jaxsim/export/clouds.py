"""The clouds that a detector learns from: measured, from depth alone, or with the intensity of a trained sensor.

The paper's three ways to place the sensor: *projected from the camera* (`depth` or `simulated` with projection
`camera`: a point a pixel, carried to the LiDAR's frame); *projected before the network* (`simulated` with projection
`grid`: the network sees the LiDAR's own grid); and *an additional camera at the LiDAR*, which is the first way on
frames whose camera stands there (`--lidar camera`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np

from jaxsim.cloud import PATTERNS, EvenLines, crop_cloud, depth_to_cloud, sparsify
from jaxsim.config import CloudRecipe
from jaxsim.data.polar_frames import read_grid
from jaxsim.effects.chain import SensorModel
from jaxsim.frame import Array, Cloud, Frame, PolarGrid
from jaxsim.geometry import PRESETS, full_grid, polar_to_points
from jaxsim.geometry.points import FAR_M
from jaxsim.prepare import dense_view
from jaxsim.simulate.frames import motion_of, take, with_effects
from jaxsim.simulate.learned_sensor import LearnedSensor

NO_LINES = "none"
_KNOWN = {*PATTERNS, *PRESETS, NO_LINES}


def check_recipe(recipe: CloudRecipe, learned: LearnedSensor | None, effects_model: SensorModel | None = None) -> None:
    """Raises ValueError for lines that nobody knows, for beams of lines that name theirs, for a simulated cloud without
    a trained sensor, for another with one, and for effects on a cloud of pixels."""
    if lines_of(recipe) not in _KNOWN and grid_file(recipe) is None:
        names = ", ".join(sorted(_KNOWN))
        raise ValueError(f"clouds: no lines named {recipe.lines!r}; known: {names}, or a folder that holds a grid.json")
    if recipe.beams and lines_of(recipe) == NO_LINES:
        raise ValueError("clouds: beams are rows of lines, and there are none; name them with --recipe.lines 64")
    if recipe.beams and PATTERNS.get(lines_of(recipe), (None, None))[1] is not None:
        raise ValueError(
            f"clouds: {recipe.lines} already keeps some of its rows; name those that you want of all: "
            f"--recipe.lines 64 --recipe.beams {' '.join(map(str, recipe.beams))}"
        )
    if recipe.source == "simulated" and learned is None:
        raise ValueError("clouds: a simulated cloud needs a trained sensor; name its run with --run runs/NAME")
    if recipe.source != "simulated" and learned is not None:
        raise ValueError(
            f"clouds: a run was given, and no sensor simulates clouds of source {recipe.source}; leave --run out, or "
            "give --recipe.source simulated"
        )
    if effects_model is not None and (recipe.source, recipe.projection) != ("simulated", "grid"):
        raise ValueError(
            "clouds: effects act on rays of the sensor's own grid, and a cloud of pixels has none; with --effects give "
            "--recipe.source simulated --recipe.projection grid"
        )


def lines_of(recipe: CloudRecipe) -> str:
    """The name of the recipe's lines, what is not named filled in."""
    # A cloud of pixels is denser than any sensor's: unless other lines are asked for, it is thinned to 64.
    of_pixels = recipe.source == "depth" or (recipe.source == "simulated" and recipe.projection == "camera")
    return recipe.lines or ("64" if of_pixels else NO_LINES)


def grid_file(recipe: CloudRecipe) -> Path | None:
    """The grid.json that the recipe's lines are in; None where they have a name, or there is no such file."""
    path = Path(lines_of(recipe)) / "grid.json"
    return path if lines_of(recipe) not in _KNOWN and path.is_file() else None


def make_cloud(
    frame: Frame,
    recipe: CloudRecipe,
    learned: LearnedSensor | None = None,
    *,
    effects_model: SensorModel | None = None,
    key: Array | None = None,
    first_s: float | None = None,
) -> Cloud:
    """The cloud of one frame, host memory; points that are not there are not valid.

    `effects_model` is what the learned sensor lacks, drawn with `key` (by default that of seed 0); what drifts counts
    from `first_s`, the time of the data set's first frame (by default this frame's own). Raises ValueError where the
    frame lacks what the recipe needs, and as `check_recipe`.
    """
    check_recipe(recipe, learned, effects_model)
    drawn = jax.random.key(0) if key is None else key
    motion = motion_of(frame, (frame.time_s or 0.0) if first_s is None else first_s)
    dense = _dense(frame, recipe, learned, effects_model=effects_model, key=drawn, motion=motion)
    lines = lines_of(recipe)
    if lines != NO_LINES:
        cells, rows = _cells(lines)
        # Beams that the recipe names are kept instead of those that the published pattern keeps.
        beams = tuple(recipe.beams) or rows
        # The published lines belong with the published crop; a sensor's own beams bound what they see.
        dense = crop_cloud(dense) if lines in PATTERNS else dense
        # The published program keeps the last point that falls into a cell; a sensor sees the nearest.
        winner = "last" if recipe.published else "nearest"
        dense = sparsify(dense, cells, beams=beams, winner=winner, clamp=recipe.published)
    return jax.tree.map(np.asarray, dense)


def _cells(lines: str) -> tuple[EvenLines | PolarGrid, Sequence[int] | None]:
    if lines in PATTERNS:
        return PATTERNS[lines]
    return (full_grid(PRESETS[lines]) if lines in PRESETS else read_grid(lines)[0]), None


def _dense(
    frame: Frame,
    recipe: CloudRecipe,
    learned: LearnedSensor | None,
    *,
    effects_model: SensorModel | None,
    key: Array,
    motion: dict[str, float | None],
) -> Cloud:
    view = frame.camera
    if recipe.source == "measured":
        if frame.cloud is None:
            raise ValueError(
                f"clouds: {frame.name} has no measured cloud; make one: --recipe.source depth or simulated"
            )
        return frame.cloud
    if recipe.projection == "grid" and recipe.source == "simulated" and learned is not None:
        grid, _ = learned.window
        batch = jax.tree.map(lambda leaf: np.asarray(leaf)[None], dense_view(frame, learned.run.experiment.prepare))
        image, painted = take(learned.simulate_view(batch), 0)
        # Rays that the network drops stay, with intensity 0, which KITTI's own scans have too.
        # What lies farther than any LiDAR sees is none of them.
        image = replace(image, valid=painted.valid & (painted.range_m <= FAR_M)) if recipe.keep_zero else image
        if effects_model is not None:
            image = with_effects(effects_model, image, painted, grid=grid, key=key, **motion)
        return polar_to_points(image, grid)
    if view.depth_m is None:
        raise ValueError(
            f"clouds: {frame.name} has no depth, which a cloud of pixels is made of; take a renderer's data set, or "
            "--recipe.source measured"
        )
    # Depth 0 is a renderer's nothing; as a point it would lie in the camera's centre.
    has_depth = np.isfinite(view.depth_m) & (np.asarray(view.depth_m) > 0)
    has_depth = has_depth if view.depth_valid is None else has_depth & np.asarray(view.depth_valid)
    intensity = learned.intensity_map(view) if recipe.source == "simulated" and learned is not None else None
    cloud = depth_to_cloud(
        view.camera,
        view.depth_m,
        has_depth,
        intensity=intensity,
        drop_zero=not recipe.keep_zero,
        max_high_m=recipe.max_high_m,
    )
    # A renderer's depth goes on to the horizon; what lies farther than any LiDAR sees is no point.
    return replace(cloud, valid=cloud.valid & (np.abs(np.asarray(cloud.xyz_m)).max(-1) <= FAR_M))
