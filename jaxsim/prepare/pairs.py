"""One frame of a drive to one training pair: the paper's two processing figures, step by step.

The pair lies on the polar window that the cropped camera image covers: with KITTI's calibration 44 laser
lines x 372 columns. It depends on calibration and sensor alone, so all frames of a drive share it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.config import PrepareConfig
from jaxsim.files import placed
from jaxsim.frame import Array, Camera, CameraFrame, Cloud, Frame, Pair, PolarGrid, PolarImage
from jaxsim.geometry import (
    LidarSpec,
    camera_rows,
    camera_window,
    crop_camera,
    network_incidence,
    pad_cloud,
    scan_on_window,
)
from jaxsim.geometry.camera import crop_offsets
from jaxsim.geometry.rasters import all_within, check_array, check_rasters, span_in_words
from jaxsim.prepare.denoise import denoise
from jaxsim.prepare.denoise.lidia import open_lidia
from jaxsim.prepare.depth import complete_view, sparse_depth
from jaxsim.prepare.depth.penet import check_crop, open_penet
from jaxsim.prepare.paint import paint


def check_networks(config: PrepareConfig) -> None:
    """Opens the weights of the networks that a config asks for, so that what is wrong with them is told before a frame
    is made of it or a folder begun.

    Raises ValueError or FileNotFoundError where they are missing, are of another network or do not fit the settings.
    """
    if config.denoise == "lidia":
        open_lidia(config.denoise_weights).check(config.denoise_gain)
    if config.depth == "penet":
        open_penet(config.depth_weights)
        check_crop(config.image_crop)


def prepare_frame(frame: Frame, spec: LidarSpec, config: PrepareConfig) -> tuple[Pair, PolarGrid]:
    """The pair of a frame (host memory) and its polar window.

    Raises ValueError where the frame lacks what the config asks for: labels, depth, laser lines, image size; and where
    the cloud's intensity is not 0..1, or none of it lies in the window.
    """
    cloud = _measured(frame)
    if cloud.row is None:
        raise ValueError(
            f"prepare: {frame.name}: the cloud has no laser lines; give it cloud.row (recover_rows, rows_by_elevation)"
        )
    _check_cloud(frame.name, cloud)
    pair, grid = prepare_view(frame, spec, config)
    measured = scan_on_window(cloud, grid, pair.row_share[:, 0], lines=spec.rows)
    _check_gaps(frame.name, measured.valid)
    with placed(frame.name):
        target = denoise(
            measured.intensity,
            measured.valid,
            config.denoise,
            weights=config.denoise_weights,
            statistics=config.denoise_statistics,
            gain=config.denoise_gain,
        )
    return replace(pair, target=target, measured=measured), grid


def prepare_view(frame: Frame, spec: LidarSpec, config: PrepareConfig) -> tuple[Pair, PolarGrid]:
    """The pair of a frame that no LiDAR measured, and its polar window: what the camera knows; no beam came back.

    Raises ValueError where the frame lacks what the config asks for: labels, depth, image size.
    """
    view = dense_view(frame, config)
    grid, rows = polar_window(frame.camera.camera, frame.camera.rgb.shape[-3:-1], spec, config=config)
    painted = paint(view, grid, occlusion_m=config.occlusion_m)
    angle = network_incidence(painted.range_m, painted.valid, grid)
    # To the host: pairs are kept in files.
    painted, angle = jax.tree.map(np.asarray, (painted, angle))
    nothing = np.zeros(angle.shape, np.float32)
    pair = Pair(
        painted=painted,
        incidence_rad=angle,
        row_share=np.broadcast_to(rows[:, None], angle.shape).copy(),
        target=nothing,
        measured=PolarImage(range_m=nothing, intensity=nothing, valid=np.zeros(angle.shape, bool)),
    )
    return pair, grid


def dense_view(frame: Frame, config: PrepareConfig) -> CameraFrame:
    """What the network is given of a frame: the cropped view with dense depth.

    A frame that no LiDAR measured comes with a depth of its own, and keeps it whatever the config asks for.
    Raises ValueError where the frame lacks what the config asks for: depth, labels, image size; and where a raster is
    not what it must be (`check_rasters`).
    """
    with placed(frame.name):
        check_rasters(frame.camera, "prepare")
        view = crop_image(frame.camera, config.image_crop)
        completed = config.depth != "given" and not _is_rendered(frame)
        check_view(view, config, with_depth=not completed)  # before depth is completed, which takes its time
        if completed:
            rows_cut = frame.camera.rgb.shape[-3] - config.image_crop[0]
            cloud = pad_cloud(_measured(frame))
            depth_m, valid = jax.device_get(sparse_depth(cloud, view.camera, config.image_crop))
            view = complete_view(
                view, depth_m, valid, method=config.depth, weights=config.depth_weights, rows_cut=rows_cut
            )
        check_view(view, config)
    return view


def _is_rendered(frame: Frame) -> bool:
    """Whether the frame has a depth of its own, and no cloud that another could be completed from."""
    return frame.cloud is None and frame.camera.depth_m is not None


def _measured(frame: Frame) -> Cloud:
    """The frame's cloud. Raises ValueError where it has none."""
    if frame.cloud is None:
        raise ValueError(
            f"prepare: {frame.name} has no cloud: no LiDAR measured it, so there is nothing to learn from it and no "
            "depth to complete; it is for jaxsim simulate"
        )
    return frame.cloud


def check_frame(frame: Frame, config: PrepareConfig) -> None:
    """Raises ValueError where a frame lacks what a config asks for, naming all of it and the flags that mend it: image
    size, depth, labels, an image."""
    given = config.depth == "given" or _is_rendered(frame)
    lacks = _lacks(frame.camera, config, with_depth=given)
    try:
        _offsets(frame.camera.rgb.shape[-3:-1], config.image_crop)
    except ValueError as error:
        lacks.insert(0, str(error).removeprefix("prepare: "))
    with placed(frame.name):
        _refuse(lacks)


def check_view(view: CameraFrame, config: PrepareConfig, *, with_depth: bool = True) -> None:
    """Raises ValueError where a view lacks depth, or labels or an image that the config's inputs need: all of it at
    once, with the flags that mend it."""
    _refuse(_lacks(view, config, with_depth=with_depth))


def _refuse(lacks: Sequence[str]) -> None:
    if lacks:
        raise ValueError(f"prepare: {'; and '.join(lacks)}")


def _lacks(view: CameraFrame, config: PrepareConfig, *, with_depth: bool) -> list[str]:
    lacks: list[str] = []
    if with_depth and (view.depth_m is None or view.depth_valid is None):
        lacks.append(
            "the view has no depth; give depth_m and depth_valid, or train on depth that is completed from the LiDAR's "
            "points: --prepare.depth ip_basic_fast"
        )
    missing = {name: "class labels" for name in ("semantic", "edges") if view.semantic is None}
    missing |= {name: "an image" for name in ("rgb", "surroundings") if not view.has_image}
    needed = {name: missing[name] for name in config.inputs if name in missing}
    if needed:
        rest = " ".join(name for name in config.inputs if name not in needed)
        rest = rest or ("rgb depth row" if view.has_image else "depth row")
        lacks.append(
            f"the inputs {' and '.join(needed)} need {' and '.join(dict.fromkeys(needed.values()))}, which this view "
            f"does not have; train without them, --prepare.inputs {rest}, or choose frames that have it"
        )
    return lacks


def polar_window(
    camera: Camera, size: tuple[int, int], spec: LidarSpec, *, config: PrepareConfig
) -> tuple[PolarGrid, Float[np.ndarray, " rows"]]:
    """The polar window that the crop of a camera's image (`size`: rows, columns) covers, and each beam's place
    in the sensor (0 top line, 1 bottom line)."""
    cropped = crop_camera(camera, *_offsets(size, config.image_crop))
    grid = camera_window(cropped, config.image_crop, spec, columns=config.columns)
    first, stop = camera_rows(cropped, config.image_crop, spec)
    return grid, (np.arange(first, stop) / max(spec.rows - 1, 1)).astype(np.float32)


def _offsets(size: tuple[int, int], crop: tuple[int, int]) -> tuple[int, int]:
    """Rows cut off the top and columns off the left."""
    with placed("prepare", then=f"lower --prepare.image-crop to at most {size[0]} {size[1]}"):
        return crop_offsets(size, crop)


def crop_image(view: CameraFrame, size: tuple[int, int]) -> CameraFrame:
    """The bottom `size[0]` rows and middle `size[1]` columns of every raster, and the camera of that part."""
    top, left = _offsets(view.rgb.shape[-3:-1], size)
    columns = size[1]

    def cut(raster: Array | None) -> Array | None:
        return None if raster is None else raster[..., top:, left : left + columns]

    return CameraFrame(
        rgb=view.rgb[..., top:, left : left + columns, :],
        camera=crop_camera(view.camera, top, left),
        depth_m=cut(view.depth_m),
        depth_valid=cut(view.depth_valid),
        semantic=cut(view.semantic),
        instance=cut(view.instance),
        has_image=view.has_image,
    )


FEWEST_HIT = 0.25
"""Share of the window's columns with a point below which the number of columns alone is not the reason."""


def _check_cloud(name: str, cloud: Cloud) -> None:
    """Raises ValueError for arrays that a compiled program would read as others (`check_array`), and where the
    intensity to learn is on another scale than 0..1, on which networks are trained."""
    for array, values in vars(cloud).items():
        check_array(values, f"prepare: {name}: the cloud's {array}")
    intensity = np.asarray(cloud.intensity)[np.asarray(cloud.valid)]
    if not all_within(intensity, 0, 1):
        raise ValueError(
            f"prepare: {name}: the cloud's intensity spans {span_in_words(intensity)}; it must lie in 0..1: divide by "
            "the sensor's full scale (255 for bytes), and mark points without intensity as not valid"
        )


def _check_gaps(name: str, valid: Bool[np.ndarray, "rows columns"]) -> None:
    """Raises ValueError where no column got a point, and where empty ones keep alternating with others: the sensor
    fires too seldom for them."""
    hit = np.asarray(valid.any(axis=0))
    # Borders from seen to empty columns: a hidden sector has one, gaps between firings have many.
    if not hit.any() or (hit[:-1] & ~hit[1:]).sum() > 0.05 * len(hit):
        fewer = round(0.8 * hit.sum())
        if fewer < FEWEST_HIT * len(hit):
            raise ValueError(
                f"prepare: {name}: only {int(hit.sum())} of the window's {len(hit)} columns got a point: "
                "the points lie elsewhere than the camera looks, or the window is far finer than the sensor's azimuth "
                "step; check the calibration (R and T from LiDAR to camera), or lower --prepare.columns"
            )
        raise ValueError(
            f"prepare: {name}: {int((~hit).sum())} of the window's {len(hit)} columns, all over it, got no point: "
            "the window is finer than the sensor's azimuth step, and the gaps would be learned as dropped rays; "
            f"lower --prepare.columns to about {fewer}"
        )
