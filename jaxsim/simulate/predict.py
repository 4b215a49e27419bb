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
from flax import struct
from jaxtyping import Bool, Float

from jaxsim.config import QUANTILES, PrepareConfig
from jaxsim.frame import INTENSITY_STEP, LOST_BELOW, Array, CameraFrame, Painted, Pair, PolarGrid, PolarImage
from jaxsim.geometry import network_incidence, resample
from jaxsim.geometry.points import FAR_M
from jaxsim.geometry.rasters import check_rasters
from jaxsim.prepare import network_inputs, paint, paint_raster, shrink
from jaxsim.simulate.grain import Grain, Ranks, draw_ranks

Generate = Callable[[Any, Array], Array]
"""(parameters, inputs (b, h, w, c)) -> image (b, h, w, 1) in [-1, 1]; or QUANTILES so, and the logit of a drop."""
_Cells = Float[Array, "*b rows columns"]
NetworkWindow = tuple[PolarGrid, Float[Array, " rows"]]
"""A polar grid, and each beam's place in the sensor: 0 top, 1 bottom."""


@struct.dataclass
class Prediction:
    """What a network says of each cell. Only one that gives a distribution has `quantiles` and `drop_share`."""

    intensity: _Cells
    """0..0.99 in steps of 1/100, also of a cell that drops: what it would report, by the median."""
    drops: Bool[Array, "*b rows columns"]
    quantiles: Float[Array, "*b rows columns k"] | None = None
    """Quantiles of the intensity, 0..1, of a ray that comes back, at the probabilities QUANTILES."""
    drop_share: _Cells | None = None
    """Probability that the ray is lost or reports 0."""

    @property
    def reported(self) -> _Cells:
        """Intensity 0..0.99; 0 is a ray that does not come back, and nothing else is."""
        return jnp.where(self.drops, 0.0, jnp.maximum(self.intensity, INTENSITY_STEP))


def drawn(says: Prediction, key: Array, ranks: Ranks | None = None) -> _Cells:
    """Intensity 0..0.99 of one draw from a network's distribution; 0 is a ray that does not come back.

    A ray drops with its own probability; else its intensity is the quantile at a probability that is drawn evenly from
    0..1. Quantiles are linear between those at QUANTILES, and beyond the outer ones they go on as steeply as beside
    them. Each cell is drawn for itself, unless `ranks` are given (`draw_ranks`). `key` has the batch's dims.

    Raises ValueError where the network gives no distribution.
    """
    if says.quantiles is None or says.drop_share is None:
        raise ValueError(
            "simulate: this run's network gives one intensity a cell, not a distribution to draw from; leave out "
            "--draws, or train one with --generator.form unet"
        )
    # A key a view: what is drawn of a frame does not depend on the batch that it came in.
    if key.ndim:
        return jax.vmap(drawn)(says, key, ranks)
    if ranks is None:
        of_intensity, of_drop = jax.random.split(key)
        shape = says.intensity.shape
        ranks = Ranks(jax.random.uniform(of_intensity, shape), jax.random.uniform(of_drop, shape))
    u = ranks.intensity
    values = jnp.moveaxis(says.quantiles, -1, 0)
    # Pieces from quantile to quantile; the first and the last go on beyond their ends.
    intensity = values[0]
    for k in range(len(QUANTILES) - 1):
        slope = (values[k + 1] - values[k]) / (QUANTILES[k + 1] - QUANTILES[k])
        piece = values[k] + slope * (u - QUANTILES[k])
        intensity = jnp.where((u >= QUANTILES[k]) | (k == 0), piece, intensity)
    # A ray that comes back reports a step at least, for 0 is what a lost one reports.
    drops = ranks.drop < says.drop_share
    return jnp.where(drops, 0.0, jnp.maximum(_on_steps(intensity), INTENSITY_STEP))


def predict_cells(
    generate: Generate,
    params: Any,
    painted: Painted,
    *,
    incidence_rad: _Cells,
    row_share: Float[Array, "... rows"],
    prepare: PrepareConfig,
) -> Prediction:
    """What the network says of each cell of the polar window. `row_share` is each beam's place in the sensor, 0 top,
    1 bottom.

    The window is scaled to the network's size cell by cell and back, so each cell keeps its own answer.
    """
    *batch, rows, columns = incidence_rad.shape
    row_shares = jnp.broadcast_to(row_share, incidence_rad.shape[:-1])[..., None]
    inputs = network_inputs(painted, incidence_rad, row_shares, prepare=prepare)
    inputs = inputs.reshape(-1, *inputs.shape[-3:])
    outputs = generate(params, inputs)
    channels = jnp.moveaxis(outputs, -1, 0).reshape(outputs.shape[-1], *batch, *outputs.shape[1:3])
    channels = resample(channels, (rows, columns), batch_dims=len(batch) + 1)
    # A unet gives a channel for each of QUANTILES and one of the drop; other generators give one intensity.
    distribution = outputs.shape[-1] > len(QUANTILES)
    # The generator's -1..1 is intensity 0..1, here put on the steps that the sensor reports.
    values = (channels + 1) / 2
    if not distribution:
        intensity = _on_steps(values[0])
        # Lost rays were learned as intensity 0: what rounds to 0 is one.
        return Prediction(intensity, intensity < LOST_BELOW)
    # Each quantile is learned by itself, and they may cross; in order they are no worse (Chernozhukov et al. 2010).
    quantiles = jnp.clip(jnp.sort(jnp.moveaxis(values[: len(QUANTILES)], 0, -1), axis=-1), 0, 1)
    # The last channel is a logit, not on the scale of intensities.
    share = jax.nn.sigmoid(channels[-1])
    return Prediction(_on_steps(quantiles[..., QUANTILES.index(0.5)]), share > 0.5, quantiles, share)


def _on_steps(intensity: _Cells) -> _Cells:
    return jnp.clip(jnp.round(intensity / INTENSITY_STEP), 0, 99) * INTENSITY_STEP


def make_predict(generate: Generate, prepare: PrepareConfig) -> Callable[[Any, Pair], Prediction]:
    """Jitted: (parameters, pair or batch of pairs) -> what the network says of the polar window."""

    @jax.jit
    def predict(params: Any, pair: Pair) -> Prediction:
        seen = {"incidence_rad": pair.incidence_rad, "row_share": pair.row_share[..., 0]}
        return predict_cells(generate, params, pair.painted, **seen, prepare=prepare)

    return predict


def simulate_frame(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    *,
    row_share: Float[Array, " rows"],
    generate: Generate,
    prepare: PrepareConfig,
    key: Array | None = None,
    grain: Grain | None = None,
) -> tuple[PolarImage, Painted]:
    """What the LiDAR reports of a camera's view, and what was painted on its grid on the way; with `key` a draw from
    what the network holds possible (`drawn`), whose cells scatter together as `grain` says, else what it holds most
    likely.

    The paper's steps: carry the camera's rasters to the polar grid through depth and calibration, predict the
    intensity there, drop the rays of zero intensity. `row_share` is each beam's place in the sensor, 0 top, 1 bottom.

    Raises ValueError as `check_rasters`, of shapes and types alone where it is traced.
    """
    check_rasters(view, "simulate")
    painted = paint(view, grid, occlusion_m=prepare.occlusion_m)
    angle = network_incidence(painted.range_m, painted.valid, grid)
    seen = {"incidence_rad": angle, "row_share": row_share}
    return simulate_painted(params, painted, **seen, generate=generate, prepare=prepare, key=key, grain=grain), painted


def simulate_painted(
    params: Any,
    painted: Painted,
    *,
    incidence_rad: _Cells,
    row_share: Float[Array, " rows"],
    generate: Generate,
    prepare: PrepareConfig,
    key: Array | None = None,
    grain: Grain | None = None,
) -> PolarImage:
    """What the LiDAR reports of rays whose surfaces are known already; `key` and `grain` as in `simulate_frame`."""
    says = predict_cells(generate, params, painted, incidence_rad=incidence_rad, row_share=row_share, prepare=prepare)
    if key is None:
        return _reported(painted, says.reported)
    return _reported(painted, drawn(says, key, None if grain is None else draw_ranks(grain, painted, key)))


def camera_intensity(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    *,
    row_share: Float[Array, " rows"],
    generate: Generate,
    prepare: PrepareConfig,
) -> Float[Array, "*b h w"]:
    """Intensity 0..0.99 of every pixel of a cropped view; 0 is a ray that does not come back.

    `grid` gives the size that the view is scaled to, and `row_share` its lines' places in the sensor: the image's rows
    stand for them from top to bottom. Each pixel takes the intensity of the cell that its centre falls into.
    """
    shrunk = shrink(view, (len(grid.elevation_rad), len(grid.azimuth_rad)))
    angle = network_incidence(shrunk.range_m, shrunk.valid, grid)
    says = predict_cells(generate, params, shrunk, incidence_rad=angle, row_share=row_share, prepare=prepare)
    # Intensity in steps of 1/100, 0 for a ray that does not come back.
    intensity = says.reported
    return resample(intensity, view.rgb.shape[-3:-1], batch_dims=intensity.ndim - 2)


def simulate_unprojected(
    params: Any,
    view: CameraFrame,
    grid: PolarGrid,
    *,
    row_share: Float[Array, " rows"],
    generate: Generate,
    prepare: PrepareConfig,
) -> tuple[PolarImage, Painted]:
    """As `simulate_frame`, but the network sees the view without projection; then its answer is carried to the grid."""
    # The network's answer is one more raster of the camera's pixels: each cell takes it from the very pixel that gives
    # it range and labels.
    intensity = camera_intensity(params, view, grid, row_share=row_share, generate=generate, prepare=prepare)
    painted = paint(view, grid, occlusion_m=prepare.occlusion_m)
    carried = paint_raster(intensity, view, grid, occlusion_m=prepare.occlusion_m)
    return _reported(painted, carried), painted


def _reported(painted: Painted, intensity: _Cells) -> PolarImage:
    """Rays of intensity 0 do not come back; nor do those that a camera sees end beyond what any LiDAR sees."""
    return PolarImage(painted.range_m, intensity, painted.valid & (intensity > 0) & (painted.range_m <= FAR_M))
