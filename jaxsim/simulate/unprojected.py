"""Simulation as the paper does it on a renderer's images: the network sees the camera's rasters, scaled down.

Training knows the camera's rasters in the LiDAR's grid. The paper leaves this projection out for Virtual KITTI: image,
depth and labels are scaled to the window's size, and the predicted intensities are those of the image's pixels. Only
the resulting points lie where the LiDAR would have them.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, CameraFrame, Painted, PolarGrid, PolarImage
from jaxsim.geometry import incidence, resample
from jaxsim.prepare import paint, paint_raster, shrink
from jaxsim.simulate.predict import Generate, predict_intensity


def camera_intensity(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    row: Float[Array, " rows"],
    *,
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
    intensity = predict_intensity(generate, params, shrunk, angle, rows, prepare=prepare)
    lead = intensity.ndim - 2
    return resample(intensity, view.rgb.shape[-3:-1], batch_dims=lead)


def simulate_unprojected(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    row: Float[Array, " rows"],
    *,
    generate: Generate,
    prepare: PrepareConfig,
) -> tuple[PolarImage, Painted]:
    """As `simulate_frame`, but the network sees the view without projection; then its answer is carried to the grid."""
    intensity = camera_intensity(params, view, grid, row, generate=generate, prepare=prepare)
    painted = paint(view, grid, occlusion_m=prepare.occlusion_m)
    carried = paint_raster(intensity, view, grid, occlusion_m=prepare.occlusion_m)
    return PolarImage(painted.range_m, carried, painted.valid & (carried > 0)), painted
