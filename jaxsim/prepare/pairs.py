"""One frame of a drive to one training pair: the paper's two processing figures, step by step.

The pair lies on the polar window that the cropped camera image covers: with KITTI's calibration 44 laser
lines x 372 columns. It depends on calibration and sensor alone, so all frames of a drive share it.
"""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.config import PrepareConfig
from jaxsim.frame import Array, CameraFrame, Cloud, Frame, Pair, PolarGrid
from jaxsim.geometry import LidarSpec, camera_rows, camera_window, crop_camera, incidence, points_to_polar
from jaxsim.prepare.denoise import denoise
from jaxsim.prepare.depth import complete_depth
from jaxsim.prepare.depth.sparse import sparse_depth
from jaxsim.prepare.edges import edge_map
from jaxsim.prepare.paint import paint

_POINTS = 2**15  # clouds are padded to a multiple, so that kernels are compiled once and not for every frame


def prepare_frame(frame: Frame, spec: LidarSpec, config: PrepareConfig) -> tuple[Pair, PolarGrid]:
    """The pair of a frame (host memory) and its polar window.

    Raises ValueError where the frame lacks what the config asks for: labels, depth, laser lines, image size.
    """
    line = frame.cloud.row
    if line is None:
        raise ValueError(
            f"prepare: {frame.name}: the cloud has no laser lines; give it cloud.row (recover_rows, "
            "rows_by_elevation)"
        )
    try:
        view = frame.camera
        if config.depth == "ip_basic":
            view = _completed(crop_image(view, config.image_crop), _padded(frame.cloud))
        view, grid, place = view_on_window(view, spec, config)
    except ValueError as error:
        raise ValueError(f"{frame.name}: {error}") from error

    first, _ = camera_rows(view.camera, config.image_crop, spec)
    cloud = _padded(replace(frame.cloud, row=(line - first).astype(np.int32)))
    painted = paint(view, grid, occlusion_m=config.occlusion_m)
    angle, known = incidence(painted.range_m, painted.valid, grid)
    measured, _ = points_to_polar(cloud, grid)
    painted, angle, known, measured = jax.tree.map(np.asarray, (painted, angle, known, measured))
    pair = Pair(
        painted=painted,
        incidence_rad=np.where(known, angle, np.float32(np.pi / 2)),
        edges=np.asarray(edge_map(painted.semantic, painted.instance)),
        row=np.broadcast_to(place[:, None], painted.valid.shape).copy(),
        target=denoise(measured.intensity, measured.valid, config.denoise),
        measured=measured,
    )
    return pair, grid


def view_on_window(
    view: CameraFrame, spec: LidarSpec, config: PrepareConfig
) -> tuple[CameraFrame, PolarGrid, Float[Array, " rows"]]:
    """A camera's view cropped as the config says, the polar window it covers, and each beam's place in the
    sensor (0 top line, 1 bottom line).

    A batch of views shares one camera. Raises ValueError where the view lacks depth, labels that the config's
    inputs need, or is smaller than the crop.
    """
    if view.depth_m is None or view.depth_valid is None:
        raise ValueError(
            "prepare: the view has no depth; give depth_m and depth_valid, or complete it from the LiDAR's "
            "points with --prepare.depth ip_basic"
        )
    needed = [name for name in ("semantic", "edges") if name in config.inputs]
    if needed and view.semantic is None:
        rest = " ".join(name for name in config.inputs if name not in needed)
        raise ValueError(
            f"prepare: the inputs {' and '.join(needed)} need class labels, which this view does not have; "
            f"leave them out with --prepare.inputs {rest or 'rgb depth row'}"
        )
    view = crop_image(view, config.image_crop)
    *batch, _, _, _ = view.rgb.shape
    one = jax.tree.map(lambda leaf: np.asarray(leaf).reshape(-1, *leaf.shape[-2:])[0], view.camera)
    grid = camera_window(one, config.image_crop, spec, config.columns)
    first, stop = camera_rows(one, config.image_crop, spec)
    place = (np.arange(first, stop) / (spec.rows - 1)).astype(np.float32)
    camera = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (*batch, *leaf.shape[-2:])), view.camera)
    return replace(view, camera=camera), grid, place


def crop_image(view: CameraFrame, size: tuple[int, int]) -> CameraFrame:
    """The bottom `size[0]` rows and middle `size[1]` columns of every raster, and the camera of that part.

    Depth completion networks crop KITTI's images so (PENet: 352 x 1216).
    """
    *_, h, w, _ = view.rgb.shape
    rows, columns = size
    if h < rows or w < columns:
        raise ValueError(
            f"prepare: the image is {w} x {h}, smaller than the crop of {columns} x {rows}; lower "
            f"--prepare.image-crop to at most {h} {w}"
        )
    top, left = h - rows, round((w - columns) / 2)

    def cut(raster: Array | None) -> Array | None:
        return None if raster is None else raster[..., top:, left : left + columns]

    return CameraFrame(
        rgb=view.rgb[..., top:, left : left + columns, :],
        camera=crop_camera(view.camera, top, left),
        depth_m=cut(view.depth_m),
        depth_valid=cut(view.depth_valid),
        semantic=cut(view.semantic),
        instance=cut(view.instance),
    )


def _completed(view: CameraFrame, cloud: Cloud) -> CameraFrame:
    depth_m, valid = sparse_depth(cloud, view.camera, view.rgb.shape[-3:-1])
    depth_m, valid = complete_depth(np.asarray(depth_m), np.asarray(valid), "ip_basic")
    return replace(view, depth_m=depth_m, depth_valid=valid)


def _padded(cloud: Cloud) -> Cloud:
    """The cloud with invalid points behind it."""
    more = -cloud.intensity.shape[-1] % _POINTS
    return jax.tree.map(lambda leaf: np.pad(leaf, [(0, more), *[(0, 0)] * (leaf.ndim - 1)]), cloud)
