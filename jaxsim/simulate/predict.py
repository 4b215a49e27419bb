"""The paper's steps as pure functions: from a camera's view through the network to what the LiDAR reports.

Training knows the camera's rasters in the LiDAR's grid. The paper leaves this projection out for Virtual KITTI: image,
depth and labels are scaled to the window's size, and the predicted intensities are those of the image's pixels. Only
the resulting points lie where the LiDAR would have them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, CameraFrame, Painted, Pair, PolarGrid, PolarImage
from jaxsim.geometry import incidence, resample
from jaxsim.prepare import network_inputs, paint, paint_raster, shrink

Generate = Callable[[Any, Array], Array]
"""(parameters, inputs (b, h, w, c)) -> image (b, h, w, 1) in [-1, 1]."""
STEP = 0.01  # KITTI's sensor reports hundredths, 0.99 at most
Rays = Float[Array, "*b rows columns"]


def make_batch(
    prepare: PrepareConfig, *, drop_weight: float = 1.0, unseen_weight: float = 0.0
) -> Callable[[Pair], dict[str, Array]]:
    """Jitted: batched pairs to what the train step takes, at the network's size.

    The reconstruction term counts the cells that the camera saw and that are not occluded; those that did not
    come back with `drop_weight`, those that the camera did not see with `unseen_weight`.
    """

    @jax.jit
    def to_batch(pair: Pair) -> dict[str, Array]:
        # Lost rays are learned as intensity 0; how much they count beside measured ones is a setting.
        returned = jnp.where(pair.measured.valid, 1.0, drop_weight).astype(jnp.float32)
        seen = jnp.where(pair.painted.valid, 1.0, unseen_weight).astype(jnp.float32)
        counts = jnp.where(pair.painted.occluded, 0.0, seen * returned)
        target, weight = resample((pair.target, counts), prepare.network_size, batch_dims=1)
        return {
            "inputs": network_inputs(pair.painted, pair.incidence_rad, pair.row, prepare=prepare),
            "target": 2 * target[..., None] - 1,
            "weight": weight,
        }

    return to_batch


def predict_intensity(
    generate: Generate,
    params: Any,
    painted: Painted,
    *,
    incidence_rad: Rays,
    row: Rays,
    prepare: PrepareConfig,
) -> Rays:
    """Intensity 0..0.99 in steps of 1/100 on the polar window; 0 is a ray that does not come back.

    The window is scaled to the network's size cell by cell and back, so each cell keeps its own answer.
    """
    *batch, rows, columns = row.shape
    inputs = network_inputs(painted, incidence_rad, row, prepare=prepare)
    image = generate(params, inputs.reshape(-1, *inputs.shape[-3:]))[..., 0]
    image = resample(image.reshape(*batch, *image.shape[-2:]), (rows, columns), batch_dims=len(batch))
    # The generator's -1..1 is intensity 0..1, here put on the steps that the sensor reports.
    return jnp.clip(jnp.round((image + 1) / 2 / STEP), 0, 99) * STEP


def make_predict(generate: Generate, prepare: PrepareConfig) -> Callable[[Any, Pair], Array]:
    """Jitted: (parameters, pair or batch of pairs) -> intensity on the polar window."""

    @jax.jit
    def predict(params: Any, pair: Pair) -> Array:
        seen = {"incidence_rad": pair.incidence_rad, "row": pair.row}
        return predict_intensity(generate, params, pair.painted, **seen, prepare=prepare)

    return predict


def simulate_frame(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    *,
    row: Float[Array, " rows"],
    generate: Generate,
    prepare: PrepareConfig,
) -> tuple[PolarImage, Painted]:
    """What the LiDAR reports of a camera's view, and what was painted on its grid on the way.

    The paper's steps: carry the camera's rasters to the polar grid through depth and calibration, predict the
    intensity there, drop the rays of zero intensity. `row` is each beam's place in the sensor, 0 top, 1 bottom.
    """
    painted = paint(view, grid, occlusion_m=prepare.occlusion_m)
    angle, _ = incidence(painted.range_m, painted.valid, grid)
    rows = jnp.broadcast_to(row[:, None], angle.shape)
    intensity = predict_intensity(generate, params, painted, incidence_rad=angle, row=rows, prepare=prepare)
    return PolarImage(painted.range_m, intensity, painted.valid & (intensity > 0)), painted


def camera_intensity(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    *,
    row: Float[Array, " rows"],
    generate: Generate,
    prepare: PrepareConfig,
) -> Float[Array, "*b h w"]:
    """Intensity 0..0.99 of every pixel of a cropped view; 0 is a ray that does not come back.

    `grid` gives the size that the view is scaled to, and `row` its lines' places in the sensor: the image's rows stand
    for them from top to bottom. Each pixel takes the intensity of the cell that its centre falls into.
    """
    shrunk = shrink(view, (len(grid.elevation_rad), len(grid.azimuth_rad)))
    angle, _ = incidence(shrunk.range_m, shrunk.valid, grid)
    rows = jnp.broadcast_to(row[:, None], angle.shape)
    intensity = predict_intensity(generate, params, shrunk, incidence_rad=angle, row=rows, prepare=prepare)
    return resample(intensity, view.rgb.shape[-3:-1], batch_dims=intensity.ndim - 2)


def simulate_unprojected(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    *,
    row: Float[Array, " rows"],
    generate: Generate,
    prepare: PrepareConfig,
) -> tuple[PolarImage, Painted]:
    """As `simulate_frame`, but the network sees the view without projection; then its answer is carried to the grid."""
    intensity = camera_intensity(params, view, grid, row=row, generate=generate, prepare=prepare)
    painted = paint(view, grid, occlusion_m=prepare.occlusion_m)
    carried = paint_raster(intensity, view, grid, occlusion_m=prepare.occlusion_m)
    return PolarImage(painted.range_m, carried, painted.valid & (carried > 0)), painted
