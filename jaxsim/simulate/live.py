"""The learned sensor in a simulator's loop: compiled once, then a function from each tick's buffers to a point cloud.

    live = jaxsim.load("runs/kitti_drives").attach(view)         # a view, as the simulator gives it
    cloud = live(view)                                           # at each tick

or, where a ray caster asks what each ray meets, `sensor.attach_rays()`, whose `directions` are the rays to cast.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array, Camera, CameraFrame, Cloud, Painted, PolarGrid
from jaxsim.geometry import directions, known_or_right, network_incidence, polar_to_points
from jaxsim.geometry.rasters import (
    all_within,
    check_array,
    check_classes,
    check_instances,
    check_metres,
    check_rasters,
    check_shapes,
    on_host,
    span_in_words,
)
from jaxsim.prepare import check_view, crop_image, polar_window
from jaxsim.runs.kinds import Run
from jaxsim.simulate.checks import check_image
from jaxsim.simulate.predict import Generate, NetworkWindow, simulate_frame, simulate_painted

OF_CAMERA = ("rgb", "surroundings")
"""Inputs that a camera alone knows."""
CALLS = 5
"""Calls whose median is the latency."""
log = logging.getLogger(__name__)
_Raster = Float[Array, "*b rows columns"]


@dataclass(frozen=True)
class Live:
    """A camera's views to point clouds, of one size and batch; `attach` makes one."""

    run: Callable[[CameraFrame], Cloud]
    shape: tuple[int, ...]
    """Of the images: (*batch, h, w)."""
    crop: tuple[int, int]
    check: Callable[[CameraFrame], None]
    latency_s: float
    """Median of a call, buffers in host memory to cloud on the device."""

    def __call__(self, view: CameraFrame) -> Cloud:
        """The cloud in the LiDAR's frame (x forward, y left, z up), dropped rays masked.

        Raises ValueError for a view of another size or batch, where it lacks depth or labels that the run needs, and
        where a raster is not what it must be (`check_rasters`); of rasters on an accelerator shapes and types are
        checked. A view in which nothing is seen gives a cloud without a point.
        """
        if on_host(view):
            check_rasters(view, "live", may_be_empty=True)
        else:
            # A copy to the host would take longer than the sensor.
            check_shapes(view, "live")
        shape = np.shape(view.rgb)[:-1]
        if shape != self.shape:
            raise ValueError(
                f"live: the view is {shape}; it was attached to {self.shape}: attach again for another size or batch"
            )
        cropped = crop_image(view, self.crop)
        self.check(cropped)
        return self.run(cropped)


@dataclass(frozen=True)
class LiveRays:
    """What a ray caster's rays meet to point clouds; `attach_rays` makes one."""

    run: Callable[[Painted, Array | None], Cloud]
    grid: PolarGrid
    directions: Float[np.ndarray, "rows columns 3"]
    """Unit vectors in the LiDAR's frame; the rays of row k start at (0, 0, `grid.origin_m[k]`)."""
    camera: Camera
    needs: tuple[str, ...]
    latency_s: float
    """Median of a call for one sweep."""

    def __call__(
        self,
        range_m: _Raster,
        *,
        valid: Bool[Array, "*b rows columns"] | None = None,
        semantic: Int[Array, "*b rows columns"] | None = None,
        instance: Int[Array, "*b rows columns"] | None = None,
        incidence_rad: _Raster | None = None,
    ) -> Cloud:
        """The cloud of rays that end `range_m` from their origins; where they end nowhere, `range_m` is not finite or
        <= 0, or `valid` says so. `semantic` holds Cityscapes ids; without `incidence_rad` it is told from the ranges.

        Raises ValueError for rasters of another size, ranges that are not metres, classes that are no Cityscapes ids,
        angles that are not 0..pi/2 where a ray ends, and where labels are missing that the run was trained on.
        """
        size = self.directions.shape[:2]
        rasters = {"valid": valid, "semantic": semantic, "instance": instance, "incidence_rad": incidence_rad}
        for name, raster in ({"range_m": range_m} | rasters).items():
            check_array(raster, f"live: {name}")
            shape = () if raster is None else np.shape(raster)
            if raster is not None and (shape[-2:] != size or 0 in shape):
                raise ValueError(f"live: {name} is {shape}; cast `directions`, {size[0]} x {size[1]} rays")
            if raster is not None and shape != np.shape(range_m):
                raise ValueError(f"live: {name} is {shape}, range_m {np.shape(range_m)}; give both for each scan")
        away = np.asarray(range_m, np.float32)
        if semantic is None and self.needs:
            raise ValueError(
                f"live: the run was trained on {' and '.join(self.needs)}: give `semantic`, Cityscapes ids"
            )
        ends = np.isfinite(away) & (away > 0)
        ends = ends if valid is None else ends & np.asarray(valid, bool)
        # No ray may end anywhere: then there is no scale to look at.
        if ends.any():
            check_metres(away[ends], "live: range_m")
        if semantic is not None:
            check_classes(np.asarray(semantic), "live")
        if instance is not None:
            check_instances(np.asarray(instance), "live")
        if incidence_rad is not None and not all_within(angles := np.asarray(incidence_rad)[ends], 0, np.pi / 2 + 1e-3):
            raise ValueError(
                f"live: incidence_rad spans {span_in_words(angles)}; it must be the angle between ray and surface "
                "normal, 0 head on to pi/2: turn degrees into radians"
            )
        # A ray that ends nowhere is 0 in every raster, as in painted frames.
        away = np.where(ends, away, np.float32(0))
        nothing = np.zeros(away.shape, np.int32)
        painted = Painted(
            range_m=away,
            depth_m=np.where(ends, self._depth(away), np.float32(0)),
            # Nobody looks at it: `attach_rays` refuses runs that saw colours.
            rgb=np.zeros((*away.shape, 3), np.float32),
            semantic=nothing if semantic is None else np.where(ends, np.asarray(semantic, np.int32), nothing),
            instance=nothing if instance is None else np.where(ends, np.asarray(instance, np.int32), nothing),
            valid=ends,
            occluded=np.zeros(away.shape, bool),
        )
        return self.run(painted, None if incidence_rad is None else np.asarray(incidence_rad, np.float32))

    def _depth(self, range_m: Float[np.ndarray, "*b rows columns"]) -> Float[np.ndarray, "*b rows columns"]:
        """Depth as the run's own camera would have it: along its axis."""
        # Row 2 of the transform gives z in `cam`; of the beams' origins on the sensor's axis only its z entry counts.
        axis = np.asarray(self.camera.cam_from_velo, np.float32)[2]
        rise = np.asarray(self.grid.origin_m, np.float32)[:, None] * axis[2]
        return range_m * (self.directions @ axis[:3]) + rise + axis[3]


def attach_camera(run: Run, params: Any, view: CameraFrame, *, generate: Generate) -> Live:
    """Compiles the sensor for views like this one, of its size, batch, camera and labels, and logs what a call takes.

    Raises ValueError where the images are not like those that the run learned from, where the view lacks depth or
    labels, and where a raster is not what it must be (`check_rasters`).
    """
    check_rasters(view, "live")
    prepare = run.experiment.prepare
    size = view.rgb.shape[-3:-1]
    check_image(size, run)
    cropped = crop_image(view, prepare.image_crop)
    check_view(cropped, prepare)
    grid, row_share = polar_window(view.camera, size, run.spec, config=prepare)

    @jax.jit
    def cloud_of(params: Any, seen: CameraFrame, window: NetworkWindow) -> Cloud:
        grid, row_share = window
        image, _ = simulate_frame(params, seen, grid, row_share=row_share, generate=generate, prepare=prepare)
        return polar_to_points(image, grid)

    # Arguments that stay on the device: closed over, they would be constants of the program.
    weights, window = jax.device_put((params, (grid, row_share)))
    call = lambda seen: cloud_of(weights, with_cameras(seen), window)  # noqa: E731
    latency = _latency(lambda: call(crop_image(view, prepare.image_crop)))
    log.info("live: views of %s, %.0f ms a call", view.rgb.shape[:-1], 1000 * latency)
    check = lambda seen: check_view(seen, prepare)  # noqa: E731
    return Live(call, view.rgb.shape[:-1], prepare.image_crop, check, latency)


def attach_rays(run: Run, params: Any, window: NetworkWindow, *, generate: Generate) -> LiveRays:
    """Compiles the sensor for a ray caster that casts its own rays; tells the latency.

    Raises ValueError where the run was trained on what only a camera knows.
    """
    prepare = run.experiment.prepare
    missing = [name for name in prepare.inputs if name in OF_CAMERA]
    if missing:
        castable = " ".join(name for name in prepare.inputs if name not in OF_CAMERA)
        raise ValueError(
            f"live: the run was trained on {' and '.join(missing)}, which rays do not know; attach it to a camera, or "
            f"train one with --prepare.inputs {castable or 'range incidence row'}"
        )
    grid, _ = window

    @jax.jit
    def cloud_of(params: Any, painted: Painted, incidence_rad: _Raster | None, *, window: NetworkWindow) -> Cloud:
        grid, row_share = window
        # A caster's angle of a ray that ends nowhere means nothing; training had a right angle there.
        if incidence_rad is None:
            angle = network_incidence(painted.range_m, painted.valid, grid)
        else:
            angle = known_or_right(incidence_rad, painted.valid)
        seen = {"incidence_rad": angle, "row_share": row_share}
        return polar_to_points(simulate_painted(params, painted, **seen, generate=generate, prepare=prepare), grid)

    weights, window = jax.device_put((params, window))
    call = lambda painted, angle: cloud_of(weights, painted, angle, window=window)  # noqa: E731
    needs = tuple(name for name in ("semantic", "edges") if name in prepare.inputs)
    # Without a latency yet, for what is timed is the very function that is handed out.
    live = LiveRays(call, grid, np.asarray(directions(grid)), run.camera, needs, 0.0)
    # Any scene takes as long: what the network does depends on sizes alone.
    far = np.full(live.directions.shape[:2], 10, np.float32)
    latency = _latency(lambda: live(far, semantic=np.zeros(far.shape, np.int32)))
    log.info("live: %d x %d rays, %.0f ms a call", *far.shape, 1000 * latency)
    return replace(live, latency_s=latency)


def with_cameras(view: CameraFrame) -> CameraFrame:
    """Every view of a batch with its camera."""
    *batch, _, _, _ = view.rgb.shape
    spread = lambda leaf: np.broadcast_to(leaf, (*batch, *leaf.shape[-2:]))  # noqa: E731
    return replace(view, camera=jax.tree.map(spread, view.camera))


def _latency(call: Callable[[], Cloud]) -> float:
    """Seconds of a call, once it is compiled."""
    jax.block_until_ready(call())
    seconds = []
    for _ in range(CALLS):
        begun = time.perf_counter()
        jax.block_until_ready(call())
        seconds.append(time.perf_counter() - begun)
    # Of few calls one that the machine was busy with would spoil a mean.
    return median(seconds)
