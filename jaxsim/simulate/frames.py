"""Simulated frames on the host: batches of them, and effects on them."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.data import Dataset
from jaxsim.effects import get_effect, scan_of
from jaxsim.effects.chain import SensorModel
from jaxsim.files import placed
from jaxsim.frame import Array, CameraFrame, Frame, Painted, PolarGrid, PolarImage
from jaxsim.geometry import incidence, known_or_median
from jaxsim.geometry.points import FAR_M
from jaxsim.prepare import dense_view
from jaxsim.simulate.checks import check_image
from jaxsim.simulate.grain import Grain
from jaxsim.simulate.learned_sensor import LearnedSensor, Projection

BATCH = 8
"""Frames simulated together where nobody says otherwise."""


def take(tree: Any, k: int) -> Any:
    """Item k of a batch."""
    return jax.tree.map(lambda leaf: leaf[k], tree)


def simulate_batch(
    learned: LearnedSensor,
    frames: Sequence[Frame],
    size: int,
    *,
    projection: Projection = "lidar",
    keys: Sequence[Array] = (),
    grain: Grain | None = None,
) -> tuple[PolarImage, Painted, float]:
    """Simulates frames together on the run's window, filled up to `size`; results on the host, and the seconds
    from dense views to results. `keys`, one a frame, draw from the network's distribution, with this `grain`. Raises
    ValueError where a frame's images are not like those of the run."""
    for frame in frames:
        with placed(frame.name):
            check_image(frame.camera.rgb.shape[-3:-1], learned.run)
    views = _alike([dense_view(frame, learned.run.experiment.prepare) for frame in frames])
    # Filled up with copies, so that one compiled program serves the last batch, too.
    views += [views[-1]] * (size - len(views))
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *views)
    # Views come from files: what is timed is the simulation.
    begun = time.monotonic()
    key = _filled(keys, size) if keys else None
    image, painted = jax.device_get(learned.simulate_view(batch, projection=projection, key=key, grain=grain))
    return image, painted, time.monotonic() - begun


def _alike(views: Sequence[CameraFrame]) -> list[CameraFrame]:
    """Views of the same rasters, which can be one batch.

    Each has what the inputs need (`dense_view`). What else it lacks and others have is filled with 0, no class and no
    object, as it is painted of a view alone.
    """
    nothing = np.zeros(views[0].rgb.shape[:-1], np.int32)
    some = [name for name in ("semantic", "instance") if any(getattr(view, name) is not None for view in views)]
    has_image = all(view.has_image for view in views)
    filled = [{name: nothing for name in some if getattr(view, name) is None} for view in views]
    return [replace(view, has_image=has_image, **lacking) for view, lacking in zip(views, filled, strict=True)]


def _filled(keys: Sequence[Array], size: int) -> Array:
    """The keys of a batch (size,), its last one for what fills it up."""
    return jnp.stack([*keys, *[keys[-1]] * (size - len(keys))])


def rasters(painted: Painted, grid: PolarGrid) -> dict[str, np.ndarray]:
    """What a simulated polar frame holds besides range and intensity, by the names of the format.

    The incidence is that of the painted surface, with the rays that the network drops; where it cannot be told, the
    median.
    """
    # As `scan_of` takes it where a file has no angles; a right angle, which stands for what is not known in training
    # pairs, would be among those on which effects of the incidence act most.
    angle = known_or_median(*jax.device_get(incidence(painted.range_m, painted.valid, grid)))
    return {
        "semantic": np.asarray(painted.semantic).astype(np.uint8),
        "instance": np.asarray(painted.instance),
        "rgb": np.round(np.asarray(painted.rgb) * 255).astype(np.uint8),
        "incidence": angle,
    }


def begin_of(dataset: Dataset) -> float:
    """When a data set's first frame was taken (s), 0 where it does not say.

    What drifts, or acts for a time alone, counts from there, whichever frames are chosen: a frame is simulated alike
    alone and among all. Raises ValueError where that frame cannot be read.
    """
    with placed("time counts from the data set's first frame, which cannot be read", OSError):
        return dataset[0].time_s or 0.0


def motion_of(frame: Frame, first_s: float) -> dict[str, float | None]:
    """When a frame was taken, counted from `first_s`, and how the car moved; None where the frame does not say.

    Effects take it counted from the data set's first frame (`begin_of`): data sets count from 1970, of which single
    precision keeps no seconds. Files of frames have it as the data set does, counted from 0.
    """
    time_s = None if frame.time_s is None else frame.time_s - first_s
    return {"time_s": time_s, "speed_mps": frame.speed_mps, "heading_rad": frame.heading_rad}


def with_effects(
    model: SensorModel,
    image: PolarImage,
    painted: Painted,
    *,
    grid: PolarGrid,
    key: Array,
    time_s: float | None = None,
    speed_mps: float | None = None,
    heading_rad: float | None = None,
) -> PolarImage:
    """One simulated frame (rows, columns) as a sensor with these effects reports it (host memory).

    `time_s` counts from the recording's first frame, speed and heading are as in `Frame`. The effects see what the
    polar frame's file holds, so that effects which `discover` found in files act here on the same rays. Returns from
    beyond what any LiDAR sees are none. Raises and warns as `check_motion`.
    """
    check_motion(model, time_s=time_s, speed_mps=speed_mps, heading_rad=heading_rad)
    about = {"speed": speed_mps or 0.0, "heading": heading_rad or 0.0}
    for law in model.learned:
        law.check_columns(grid)
    scan = scan_of(grid, [jax.tree.map(np.asarray, image)], [rasters(painted, grid)], about=[about])
    # `scan_of` counts times from its own first frame, and this is its only one.
    scan = replace(scan, time_s=np.full(1, time_s or 0.0, np.float32))
    seen = take(model.simulate(scan, key), 0)
    # A ray that is cast again and nearly grazes a plane meets it kilometres away; no LiDAR reports that.
    return replace(seen, valid=seen.valid & (seen.range_m <= FAR_M))


def check_motion(
    model: SensorModel, *, time_s: float | None, speed_mps: float | None, heading_rad: float | None
) -> None:
    """Warns of effects that do nothing because a frame does not say how the car moves, or when it was taken.

    Raises ValueError for an effect that acts in a direction of the world on a frame that does not say where the car
    heads: it would act in the wrong one; and for a learned law along what a frame does not say.
    """
    motion = {"time": time_s, "speed": speed_mps, "heading": heading_rad}
    for law in model.learned:
        law.check_known({what: value is not None for what, value in motion.items()})
    for name, region in model.regions.items():
        if region.tag is not None or not region.acts:
            what = "no tags" if region.tag is not None else "nothing of which"
            warnings.warn(
                f"simulate: {name} of the sensor model acts in some frames alone, and a data set's frames say {what}: "
                "it is not applied",
                stacklevel=1,
            )
        elif region.time_s is not None and time_s is None:
            warnings.warn(
                f"simulate: {name} of the sensor model acts for a time alone, and these frames do not say theirs: all "
                "count as the recording's first moment",
                stacklevel=1,
            )
    # What is not said counts as 0. A speed or a time of 0 does nothing; a heading of 0 is a direction like any other.
    for name, _ in model.effects:
        what = get_effect(name).needs
        if not what or motion[what] is not None:
            continue
        if what == "heading":
            raise ValueError(
                f"simulate: {name} of the sensor model acts in a direction of the world, and these frames do not say "
                "where the car heads; take frames that do (kitti_raw with its oxts/, synthetic), or take the effect "
                "out of sensor.json"
            )
        warnings.warn(
            f"simulate: {name} of the sensor model does nothing here: these frames do not say their {what} (kitti_raw "
            "has it in oxts/data and velodyne_points/timestamps.txt)",
            stacklevel=1,
        )
