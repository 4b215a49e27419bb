"""CARLA's raw sensor buffers as camera frames: no CARLA needed, only the bytes of `image.raw_data`.

    view = read_view(rgb.raw_data, depth.raw_data, semantic.raw_data, size=(rgb.height, rgb.width), fov_deg=rgb.fov,
                     version="0.9.15", cam_from_velo=cam_from_velo(rgb.transform.get_matrix(),
                                                                   lidar.transform.get_matrix()))

Every buffer is BGRA, 8 bits each, rows from the top. Depth is planar, 24 bits over R (low), G, B (high) of 1000 m;
semantic tags stand in R; the instance camera has the tag in R and the object's number in G (low) and B (high).
CARLA's axes are Unreal's: x forward, y RIGHT, z up, left-handed; `velo` has y left. Source: CARLA's sensor reference.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from jaxsim.data.cityscapes import IDS
from jaxsim.frame import Camera, CameraFrame

_Raster = Int[np.ndarray, "h w"]
_Real = int | float

FAR_PLANE_M = 1000.0
"""Depth of the far plane: the sky."""
TAGS_0_9_14 = (
    *("unlabeled", "road", "sidewalk", "building", "wall", "fence", "pole", "traffic light", "traffic sign"),
    *("vegetation", "terrain", "sky", "person", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle"),
    *("static", "dynamic", "unlabeled", "unlabeled", "road", "ground", "bridge", "rail track", "guard rail"),
)
"""From 0.9.14 on: Cityscapes class by tag. CARLA's Other and Water become `unlabeled`, its RoadLine `road`."""
TAGS_0_9_13 = (
    *("unlabeled", "building", "fence", "unlabeled", "person", "pole", "road", "road", "sidewalk", "vegetation", "car"),
    *("wall", "traffic sign", "sky", "ground", "bridge", "rail track", "guard rail", "traffic light", "static"),
    *("dynamic", "unlabeled", "terrain"),
)
"""Up to 0.9.13, where every vehicle is tag 10 (`car`) and riders are pedestrians. Tags 13 to 22 came with 0.9.10."""
THINGS = tuple(range(IDS["person"], IDS["bicycle"] + 1))
"""Cityscapes ids of people and vehicles: the only objects that data sets number."""
_FLIP_Y = np.diag([1.0, -1.0, 1.0, 1.0])
_CAM_FROM_UNREAL = np.array([[0, 1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], float)


def read_rgb(raw: Any, size: tuple[int, int]) -> UInt8[np.ndarray, "h w 3"]:
    """RGB of a colour camera's buffer of `size` (h, w)."""
    return np.ascontiguousarray(_bgra(raw, size)[..., 2::-1])


def decode_depth(raw: Any, size: tuple[int, int]) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Planar depth in metres, and where something is: False in the sky.

    Raises ValueError for a picture of the depth (all channels alike), which `ColorConverter.Depth` makes.
    """
    blue, green, red, _ = np.moveaxis(_bgra(raw, size).astype(np.int32), -1, 0)
    if (red == green).all() and (green == blue).all() and len(np.unique(red)) > 1:
        raise ValueError(
            "carla: red, green and blue of the depth buffer are alike everywhere: this is ColorConverter.Depth's or "
            "LogarithmicDepth's picture; pass the raw buffer (ColorConverter.Raw), which has 24 bits"
        )
    # 24 bits over 0 .. FAR_PLANE_M; the largest is the far plane, which is the sky.
    code = red + 256 * green + 65536 * blue
    return (code * (FAR_PLANE_M / (2**24 - 1))).astype(np.float32), code < 2**24 - 1


def read_semantic(raw: Any, size: tuple[int, int], *, version: str) -> _Raster:
    """Cityscapes ids of a semantic (or instance) camera's tags, whose numbers changed with `version` 0.9.14.

    Raises ValueError for a tag that the version does not have.
    """
    tags = tags_of(version)
    red = _bgra(raw, size)[..., 2]
    strange = np.unique(red[red >= len(tags)])
    if len(strange):
        raise ValueError(
            f"carla: tag {', '.join(map(str, strange[:6]))} is none of CARLA {version}'s 0..{len(tags) - 1}; pass the "
            "raw buffer (not ColorConverter.CityScapesPalette's colours) and the server's version"
        )
    return np.array([IDS[name] for name in tags], np.int32)[red]


def read_instance(raw: Any, size: tuple[int, int]) -> _Raster:
    """Number of each pixel's object, G + 256 * B, from an instance camera's buffer.

    Every mesh has a number, a house too; it is unique within a class alone, so the tag is put before it.
    """
    blue, green, red, _ = np.moveaxis(_bgra(raw, size).astype(np.int32), -1, 0)
    number = green + 256 * blue
    return np.where(number > 0, red * 65536 + number, 0)


def tags_of(version: str) -> tuple[str, ...]:
    """Cityscapes class of each tag of a CARLA version, such as `0.9.15`."""
    try:
        parts = tuple(int(part) for part in version.split("-")[0].split("."))
    except ValueError:
        raise ValueError(f"carla: version is {version!r}; give the server's, such as '0.9.15'") from None
    return TAGS_0_9_14 if parts >= (0, 9, 14) else TAGS_0_9_13


def intrinsics(size: tuple[int, int], fov_deg: _Real) -> Float[np.ndarray, "3 3"]:
    """K of a camera of `size` (h, w) and horizontal field of view.

    CARLA counts pixels from the image's corner, so that its optical axis is at (w / 2, h / 2); here pixel (0, 0) has
    its centre at 0, and the axis is half a pixel less.
    """
    (h, w), half = size, np.deg2rad(fov_deg) / 2
    if not 0 < fov_deg < 180:
        raise ValueError(f"carla: the field of view is {fov_deg} degrees; it lies between 0 and 180")
    focal = w / 2 / np.tan(half)
    return np.array([[focal, 0, (w - 1) / 2], [0, focal, (h - 1) / 2], [0, 0, 1]], np.float32)


def cam_from_velo(camera: Any, lidar: Any) -> Float[np.ndarray, "4 4"]:
    """From `velo` (y left) to `cam` (x right, y down, z forward), of two sensors' `transform.get_matrix()`.

    Both matrices, world_from_sensor or vehicle_from_sensor, are in CARLA's left-handed axes; the result is a proper
    rotation. Raises ValueError where a matrix is no rigid transform.
    """
    for name, matrix in (("camera", camera), ("lidar", lidar)):
        m = np.asarray(matrix, float)
        if m.shape != (4, 4) or not np.allclose(m[:3, :3] @ m[:3, :3].T, np.eye(3), atol=1e-4):
            raise ValueError(f"carla: the {name}'s transform is no rigid 4 x 4 matrix; pass transform.get_matrix()")
    camera_from_lidar = np.linalg.inv(np.asarray(camera, float)) @ np.asarray(lidar, float)
    return (_CAM_FROM_UNREAL @ camera_from_lidar @ _FLIP_Y).astype(np.float32)


def mirror_y(xyz_m: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
    """Points of CARLA's LiDAR in `velo`, or points of `velo` in CARLA's axes: y changes its sign."""
    return xyz_m * np.array([1, -1, 1], xyz_m.dtype)


def read_view(
    rgb: Any,
    depth: Any,
    semantic: Any | None = None,
    *,
    size: tuple[int, int],
    fov_deg: _Real,
    version: str,
    cam_from_velo: Float[np.ndarray, "4 4"],
    instance: Any | None = None,
) -> CameraFrame:
    """The camera frame of buffers that were taken at one tick from one place.

    An instance camera's buffer also gives the classes where `semantic` is left out. Of its objects people and vehicles
    are kept: a border between two house meshes is none in the labels that a network learned from.
    """
    depth_m, known = decode_depth(depth, size)
    tags = instance if semantic is None else semantic
    classes = None if tags is None else read_semantic(tags, size, version=version)
    objects = None
    if classes is not None and instance is not None:
        objects = np.where(np.isin(classes, THINGS), read_instance(instance, size), 0)
    return CameraFrame(
        rgb=read_rgb(rgb, size),
        camera=Camera(intrinsics(size, fov_deg), cam_from_velo),
        depth_m=np.where(known, depth_m, np.float32(0)),
        depth_valid=known,
        semantic=classes,
        instance=objects,
    )


def _bgra(raw: Any, size: tuple[int, int]) -> UInt8[np.ndarray, "h w 4"]:
    data = np.frombuffer(raw, np.uint8)
    if data.size != size[0] * size[1] * 4:
        raise ValueError(
            f"carla: the buffer has {data.size} bytes; an image of {size[1]} x {size[0]} has {size[0] * size[1] * 4} "
            "(BGRA): pass image.raw_data and (image.height, image.width)"
        )
    return data.reshape(*size, 4)
