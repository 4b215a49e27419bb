"""The LiDAR's points as a sparse depth image of the camera, and the frames that depth completion learns from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.config import PenetConfig, Stage
from jaxsim.files import placed
from jaxsim.frame import Array, Camera, Cloud, DepthFrame, Frame
from jaxsim.geometry import pad_cloud, project, scatter_nearest
from jaxsim.geometry.camera import crop_depth_frame, cut_depth_frame
from jaxsim.prepare.depth.ip_basic import fill_in_multiscale

_NEAREST_M = 0.1
TRUTH_REACH_M = 120.0
"""True depth beyond a LiDAR's reach is left out, as no sweep could tell it; it would rule a squared error."""


@partial(jax.jit, static_argnames="size")
def sparse_depth(
    cloud: Cloud, camera: Camera, size: tuple[int, int]
) -> tuple[Float[Array, "*b h w"], Bool[Array, "*b h w"]]:
    """Planar depth in metres of the nearest point in each pixel of an image of `size` (h, w), and its mask.

    Points nearer to the image plane than 0.1 m and points outside the image are left out, as in KITTI's
    depth-completion set; a pixel reaches half a pixel around its centre.
    """
    uv, depth_m = project(camera, cloud.xyz_m)
    pixel = jnp.floor(uv + 0.5)
    inside = cloud.valid & (depth_m > _NEAREST_M) & jnp.isfinite(depth_m)
    u, v = pixel[..., 0], pixel[..., 1]
    inside &= (u >= 0) & (u < size[1]) & (v >= 0) & (v < size[0])
    row = jnp.where(inside, v, 0).astype(jnp.int32)
    column = jnp.where(inside, u, 0).astype(jnp.int32)
    # Points that are left out take cell (0, 0) for an index alone: the mask keeps them from winning it.
    winner, valid = scatter_nearest(depth_m, row, column, inside=inside, shape=size)
    nearest = jnp.take_along_axis(depth_m, winner.reshape(*depth_m.shape[:-1], -1), axis=-1)
    return jnp.where(valid, nearest.reshape(winner.shape), 0), valid


def depth_frame(frame: Frame, crop: tuple[int, int]) -> DepthFrame:
    """A renderer's frame, its bottom rows and middle columns: the sweep's points in the image, and the rendered depth.

    Raises ValueError where the frame has no cloud or no depth, or is smaller than the crop.
    """
    view, cloud = frame.camera, frame.cloud
    if cloud is None or view.depth_m is None or view.depth_valid is None:
        raise ValueError(
            f"depth: {frame.name} has {'no LiDAR sweep' if cloud is None else 'no true depth'}; depth completion "
            "learns from frames that have both (the embedded world; KITTI's depth completion set, --depth-root)"
        )
    sparse_m, given = jax.device_get(sparse_depth(pad_cloud(cloud), view.camera, view.rgb.shape[:2]))
    known = np.asarray(view.depth_valid) & (np.asarray(view.depth_m) < TRUTH_REACH_M)
    whole = DepthFrame(view.rgb, sparse_m, given, view.depth_m, known, view.camera.intrinsics)
    with placed(f"depth: {frame.name}", then="lower --image-crop"):
        return crop_depth_frame(whole, crop)


def where_backed(frame: DepthFrame) -> DepthFrame:
    """The frame (host), its truth known only where the sweep's points back a pixel, as in KITTI's set: above the top
    line nothing says how far a facade is, and no completed depth is used there (`Penet`)."""
    backed = fill_in_multiscale(np.asarray(frame.sparse_m), np.asarray(frame.given))[1]
    return replace(frame, known=frame.known & backed)


def augment_frame(frame: DepthFrame, stage: Stage, config: PenetConfig, *, rng: np.random.Generator) -> DepthFrame:
    """A frame (host) cropped, mirrored and recoloured at random, its intrinsics with it.

    Raises ValueError where the stage's crop is larger than the frame.
    """
    rows, columns = frame.sparse_m.shape
    if stage.crop[0] > rows or stage.crop[1] > columns:
        raise ValueError(
            f"penet: the frame has {rows} x {columns} pixels, the {stage.part} stage crops {stage.crop[0]} x "
            f"{stage.crop[1]} out of it; lower that crop (penet.stages), or raise --image-crop"
        )
    top = int(rng.integers(0, rows - stage.crop[0] + 1))
    left = int(rng.integers(0, columns - stage.crop[1] + 1))
    part = cut_depth_frame(frame, top, left, size=stage.crop)
    if config.flip and rng.random() < 0.5:
        # Pixel centres are whole numbers: the mirror of u is w - 1 - u.
        part.intrinsics[0, 2] = stage.crop[1] - 1 - part.intrinsics[0, 2]
        rasters = (part.rgb, part.sparse_m, part.given, part.truth_m, part.known)
        part = DepthFrame(*[raster[:, ::-1] for raster in rasters], intrinsics=part.intrinsics)
    if config.jitter:
        part = replace(part, rgb=_recoloured(part.rgb, 1 + config.jitter * rng.uniform(-1, 1, 3)))
    return part


def _recoloured(rgb: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Brightness, contrast, saturation times these."""
    brightness, contrast, saturation = np.asarray(factors, np.float32)
    x = rgb.astype(np.float32) * brightness
    # Contrast about the image's mean, saturation about each pixel's grey.
    x = x.mean() + (x - x.mean()) * contrast
    grey = (x @ np.array([0.299, 0.587, 0.114], np.float32))[..., None]
    return np.clip(np.round(grey + (x - grey) * saturation), 0, 255).astype(np.uint8)


class Batches:
    """All batches of a training, stage after stage: batch k depends on (seed, k) alone, so a resumed run sees what an
    uninterrupted one would."""

    def __init__(self, frames: Sequence[DepthFrame], config: PenetConfig, seed: int):
        """Raises ValueError where the frames do not fill a batch of some stage."""
        for stage in config.stages:
            if len(frames) < stage.batch:
                raise ValueError(
                    f"penet: {len(frames)} training frames do not fill the {stage.part} stage's batch of {stage.batch}"
                )
        self.frames = frames
        self.config = config
        self.seed = seed
        # An epoch's last, smaller batch is left out.
        self.steps = [len(frames) // stage.batch for stage in config.stages]
        self.ends = np.cumsum([stage.epochs * n for stage, n in zip(config.stages, self.steps, strict=True)])

    def __len__(self) -> int:
        return int(self.ends[-1])

    def place(self, k: int) -> tuple[int, int, int]:
        """Number of the stage that batch k belongs to, epoch of the stage, and place in the epoch; from 0."""
        number = int(np.searchsorted(self.ends, k, side="right"))
        within = k - (int(self.ends[number - 1]) if number else 0)
        return number, *divmod(within, self.steps[number])

    def __getitem__(self, k: int) -> DepthFrame:
        number, epoch, index = self.place(k)
        stage = self.config.stages[number]
        of_epoch = [self.seed, number, epoch]
        order = np.random.default_rng(of_epoch).permutation(len(self.frames))
        chosen = [int(i) for i in order[index * stage.batch : (index + 1) * stage.batch]]
        parts = [
            augment_frame(self.frames[i], stage, self.config, rng=np.random.default_rng([*of_epoch, i])) for i in chosen
        ]
        return jax.tree.map(lambda *column: np.stack(column), *parts)
