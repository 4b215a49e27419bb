"""What travels between the stages.

Shapes: channels last, any leading batch dims `*b`. A raster has rows top to bottom and columns left to
right as the camera sees the scene; a value belongs to the centre of its cell. Every raster travels with a
mask: a cell that holds nothing is `False` in the mask, and its value means nothing.

Frames of reference: `velo` (x forward, y left, z up, origin in the LiDAR) and `cam` (x right, y down,
z forward, rectified). Transforms are named destination first: `cam_from_velo @ p_velo = p_cam`.
Azimuth is `atan2(y, x)` in `velo`: 0 forward, growing to the left, so it falls from column to column.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from flax import struct
from jaxtyping import Bool, Float, Int, UInt8

Array = Any
"""NumPy's on the host, JAX's on the device: one struct travels on both sides, and kernels take either. `Any`, because
no protocol that both satisfy has the arithmetic that kernels use; shapes and types are checked by jaxtyping at run time
in the tests, for which `Float[Array, ...]` with `Any` accepts both. Where only one may come, write jax.Array or
np.ndarray."""

CLASSES = 34
"""Cityscapes ids 0..33, in every raster `semantic`."""
INTENSITY_STEP = 0.01
"""KITTI's sensor reports intensity in hundredths, 0.99 at most."""
LOST_BELOW = INTENSITY_STEP / 2
"""A reading that rounds to intensity 0 counts as lost: a network's 0 stands for both."""


def in_notebook(value: Any) -> str:
    """HTML of a cloud, a frame or a result. Its maker, the report, stands above all that it shows, so it is looked up
    when a notebook asks."""
    return import_module("jaxsim.report.notebook").html_of(value)


@struct.dataclass
class Camera:
    """A rectified pinhole camera and its place on the LiDAR.

    An offset in the fourth column of a KITTI projection matrix is part of `cam_from_velo`.
    """

    intrinsics: Float[Array, "*b 3 3"]
    """Pixels: u = (K p)_0 / (K p)_2; pixel (0, 0) has its centre at u = v = 0."""
    cam_from_velo: Float[Array, "*b 4 4"]


@struct.dataclass
class CameraFrame:
    """What a camera or a renderer delivers. A raster that the source does not have is None."""

    rgb: UInt8[Array, "*b h w 3"]
    camera: Camera
    depth_m: Float[Array, "*b h w"] | None = None
    """Planar depth (z in `cam`), metres."""
    depth_valid: Bool[Array, "*b h w"] | None = None
    """Where the depth is known: False in the sky."""
    semantic: Int[Array, "*b h w"] | None = None
    """Cityscapes ids 0..33; 0 = unlabeled."""
    instance: Int[Array, "*b h w"] | None = None
    """Object number, unique within the frame; 0 = none."""
    has_image: bool = struct.field(pytree_node=False, default=True)
    """Whether `rgb` is an image; where the source has none, it is black and gives the size alone."""


@struct.dataclass
class Cloud:
    """Points of one sweep, in `velo`."""

    xyz_m: Float[Array, "*b n 3"]
    intensity: Float[Array, "*b n"]
    """0..1."""
    valid: Bool[Array, "*b n"]
    row: Int[Array, "*b n"] | None = None
    """Laser line of each point, 0 = top; None where it is not known."""

    def _repr_html_(self) -> str:
        return in_notebook(self)


@struct.dataclass
class PolarGrid:
    """Directions of a polar raster's cell centres. Beam origins lie on the sensor's vertical axis."""

    azimuth_rad: Float[Array, " columns"]
    """Falls from left to right, in equal steps."""
    elevation_rad: Float[Array, " rows"]
    """Elevation of each beam, seen from its own origin; top beam first."""
    origin_m: Float[Array, " rows"]
    """Height of each beam's origin above the origin of `velo`; 0 for a sensor with a single origin."""


@struct.dataclass
class PolarImage:
    """One sweep, or the part of it in a window, on a `PolarGrid`."""

    range_m: Float[Array, "*b rows columns"]
    """Distance from the beam's origin to the hit."""
    intensity: Float[Array, "*b rows columns"]
    valid: Bool[Array, "*b rows columns"]
    """The beam came back."""

    def _repr_html_(self) -> str:
        return in_notebook(self)


@struct.dataclass
class Painted:
    """Camera rasters carried to a polar grid: one camera pixel a ray."""

    range_m: Float[Array, "*b rows columns"]
    depth_m: Float[Array, "*b rows columns"]
    """Planar depth of the camera pixel."""
    rgb: Float[Array, "*b rows columns 3"]
    """0..1."""
    semantic: Int[Array, "*b rows columns"]
    instance: Int[Array, "*b rows columns"]
    valid: Bool[Array, "*b rows columns"]
    """A camera pixel with known depth fell into the cell."""
    occluded: Bool[Array, "*b rows columns"]
    """Camera pixels of clearly different depth fell into the cell: don't care."""


@struct.dataclass
class Pair:
    """A training pair on the network's grid: what the camera knows and what the LiDAR measured."""

    painted: Painted
    incidence_rad: Float[Array, "*b rows columns"]
    """Angle between ray and surface normal of the painted range; pi/2 where it cannot be told."""
    row_share: Float[Array, "*b rows columns"]
    """Laser line as a fraction of the sensor's lines, 0 top, 1 bottom."""
    target: Float[Array, "*b rows columns"]
    """Intensity to learn: measured, denoised if configured; 0 where the beam did not come back."""
    measured: PolarImage


@struct.dataclass
class DepthFrame:
    """What depth completion learns from: an image, the LiDAR's depth in it, and the depth that is to come out."""

    rgb: UInt8[Array, "*b h w 3"]
    sparse_m: Float[Array, "*b h w"]
    """Planar depth of one sweep's points, metres."""
    given: Bool[Array, "*b h w"]
    """Where there is a point."""
    truth_m: Float[Array, "*b h w"]
    known: Bool[Array, "*b h w"]
    """Where the true depth is known."""
    intrinsics: Float[Array, "*b 3 3"]
    """Pixels, of this very crop."""


@struct.dataclass
class Boxes:
    """Labelled objects, in `cam` of the frame (KITTI's convention)."""

    centre_m: Float[Array, "n 3"]
    """Middle of the bottom face."""
    size_m: Float[Array, "n 3"]
    """Length, width, height."""
    yaw_rad: Float[Array, " n"]
    """KITTI's rotation_y."""
    bbox_px: Float[Array, "n 4"]
    """Left, top, right, bottom."""
    truncated: Float[Array, " n"]
    occluded: Int[Array, " n"] | Float[Array, " n"]
    """0 visible, 1 partly, 2 largely hidden, 3 unknown; or the hidden share as a fraction (the paper's Virtual KITTI).
    Either way an object is easy at 0, moderate up to 1."""
    kind: tuple[str, ...] = struct.field(pytree_node=False, default=())


@dataclass(frozen=True)
class Frame:
    """One moment of one drive, as a reader delivers it (host memory)."""

    name: str
    """File name without folder: `2011_09_26_drive_0001_sync-0000000005`."""
    scene: str
    """The drive. Frames of one scene are never split between training and judging."""
    camera: CameraFrame
    cloud: Cloud | None
    """What the LiDAR measured; None where there was none, as in a renderer's data set."""
    time_s: float | None = None
    speed_mps: float | None = None
    """Forward, of the car; None where it is not known."""
    heading_rad: float | None = None
    """Direction of the car's x axis in the drive's world, counter-clockwise seen from above, -pi..pi."""
    boxes: Boxes | None = None
    rect_from_velo: Float[Array, "4 4"] | None = None
    """The transform to the frame that `boxes` are given in, where that is not the camera's: KITTI's rectified camera
    0."""
    ground: Float[Array, " 4"] | None = None
    """Road plane a, b, c, d in the frame of the boxes: a x + b y + c z + d = 0 with b < 0."""
