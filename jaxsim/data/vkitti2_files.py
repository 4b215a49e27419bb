"""Virtual KITTI 2's file formats (Cabon, Murray, Humenberger 2020; the README that ships with it).

Every reader stops with a ValueError that names the file, what is wrong with it and what it should be.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from jaxsim.data.calibration import check_rigid
from jaxsim.data.cityscapes import IDS
from jaxsim.files import check_image_file, check_size, image_of, parse_number, placed, read_pixels, read_text
from jaxsim.frame import Boxes

_Raster = Int[np.ndarray, "h w"]

_CATEGORIES = {
    "Terrain": ("terrain", (210, 0, 200)),
    "Sky": ("sky", (90, 200, 255)),
    "Tree": ("vegetation", (0, 199, 0)),
    "Vegetation": ("vegetation", (90, 240, 0)),
    "Building": ("building", (140, 140, 140)),
    "Road": ("road", (100, 60, 100)),
    "GuardRail": ("guard rail", (250, 100, 255)),
    "TrafficSign": ("traffic sign", (255, 255, 0)),
    "TrafficLight": ("traffic light", (200, 200, 0)),
    "Pole": ("pole", (255, 130, 0)),
    "Misc": ("unlabeled", (80, 80, 80)),
    "Truck": ("truck", (160, 60, 60)),
    "Car": ("car", (255, 127, 80)),
    "Van": ("car", (0, 139, 139)),
    "Undefined": ("unlabeled", (0, 0, 0)),
}
CITYSCAPES_OF: dict[str, str] = {name: of_cityscapes for name, (of_cityscapes, _) in _CATEGORIES.items()}
"""Class of colors.txt -> class of Cityscapes. The paper does not give its mapping."""
COLOURS: dict[str, tuple[int, int, int]] = {name: rgb for name, (_, rgb) in _CATEGORIES.items()}
"""What colors.txt says where it is left out of a copy; some scenes' omit Undefined."""
OBJECT_KINDS = ("Car", "Van", "Truck")
HEADERS = {
    "colors": "Category r g b",
    "info": "trackID label model color",
    "intrinsic": "frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]",
    "extrinsic": "frame cameraID r1,1 r1,2 r1,3 t1 r2,1 r2,2 r2,3 t2 r3,1 r3,2 r3,3 t3 0 0 0 1",
    "bbox": "frame cameraID trackID left right top bottom number_pixels truncation_ratio occupancy_ratio isMoving",
    "pose": "frame cameraID trackID alpha width height length world_space_X world_space_Y world_space_Z "
    "rotation_world_space_y rotation_world_space_x rotation_world_space_z camera_space_X camera_space_Y "
    "camera_space_Z rotation_camera_space_y rotation_camera_space_x rotation_camera_space_z",
}
"""Header line of each text file."""
SATURATED = 65535
"""The value that depth saturates to: sky, and whatever is 655.35 m away or more."""
MOST_NUMBER = 1e6
"""No number of its texts is beyond it, be it metres or pixels of an object."""
WORLD_M = 1e5
"""No street lies farther from its world's origin."""
_PNG = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE = 0, 3


@dataclass(frozen=True)
class VirtualObject:
    """One vehicle in one image, as pose.txt, bbox.txt and info.txt have it."""

    track: int
    kind: str
    """Car, Van or Truck."""
    size_m: tuple[float, float, float]
    """Length, width, height."""
    centre_m: tuple[float, float, float]
    """Middle of the bottom face in `cam`."""
    yaw_rad: float
    """KITTI's rotation_y."""
    bbox_px: tuple[float, float, float, float]
    """Left, top, right, bottom."""
    pixels: int
    """Pixels of it that are seen."""
    truncation: float
    """0 inside the image .. 1 outside."""
    occupancy: float
    """`pixels` as a share of the box's area: a car that nothing hides fills 0.65 to 0.85 of it."""


def read_depth(path: Path) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Planar depth in metres, and where it is known: False in the sky and beyond 655 m.

    16-bit grey PNG in centimetres. Raises ValueError for other encodings: 8 bits, colours, KITTI's (0 = none).
    """
    image = _read(path)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise ValueError(
            f"vkitti2: {path} is {image.dtype} with shape {image.shape}; depth is a 16-bit grey PNG in centimetres: "
            "take it from the archive vkitti_2.0.3_depth, not a picture of it"
        )
    if not image.all():
        raise ValueError(
            f"vkitti2: {path}: depth is 0 in {int((image == 0).sum())} pixels; there it is in centimetres and never 0 "
            "(65535 in the sky): is this KITTI's encoding (metres * 256, 0 = none)?"
        )
    return image.astype(np.float32) / 100, image < SATURATED


def read_classes(path: Path, colours: dict[str, tuple[int, int, int]]) -> _Raster:
    """Cityscapes ids of a class segmentation, coded by `colours`. Raises ValueError for a colour of no class."""
    image = _read(path)
    if image.dtype != np.uint8 or image.ndim != 3:
        raise ValueError(f"vkitti2: {path} is {image.dtype} with shape {image.shape}; classes are an 8-bit RGB PNG")
    # OpenCV's channels are blue, green, red.
    code = image[..., 2].astype(np.int32) << 16 | image[..., 1].astype(np.int32) << 8 | image[..., 0]
    table = sorted((r << 16 | g << 8 | b, IDS[CITYSCAPES_OF[name]]) for name, (r, g, b) in colours.items())
    known, ids = np.array(table, np.int32).T
    nearest = np.minimum(np.searchsorted(known, code), len(known) - 1)
    strange = known[nearest] != code
    if strange.any():
        first = image[strange][0][::-1].tolist()
        raise ValueError(
            f"vkitti2: {path}: {int(strange.sum())} pixels have a colour of no class, the first {tuple(first)}; the "
            f"classes are those of colors.txt ({', '.join(colours)}). Was the image resized or stored as JPEG?"
        )
    return ids[nearest]


def read_instances(path: Path) -> _Raster:
    """trackID + 1 of every vehicle's pixels, 0 elsewhere: the index, not the colour, of an indexed PNG."""
    if not path.is_file():
        raise ValueError(f"vkitti2: there is no {path}; copy it from the archive vkitti_2.0.3_instanceSegmentation")
    with placed("vkitti2"):
        return read_indexed(path).astype(np.int32)


def read_indexed(path: Path) -> UInt8[np.ndarray, "h w"]:
    """The palette index of every pixel of an indexed PNG, or the values of an 8-bit grey one.

    OpenCV would give the palette's colours; told that the file is grey, it gives the indices.
    Raises ValueError for any other file. Source: PNG specification, 4.1 and 11.2.
    """
    check_size(path, by="vkitti2")
    data = path.read_bytes()
    if not data.startswith(_PNG):
        raise ValueError(f"{path} is no PNG; copy it again")
    check_image_file(data, str(path))  # below, chunks get sums anew
    out = _PNG
    at = len(_PNG)
    depth = 8
    while at + 12 <= len(data):
        (length,), kind = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8]
        body, at = data[at + 8 : at + 8 + length], at + 12 + length
        if kind == b"IHDR":
            depth, colour = body[8], body[9]
            if colour not in (_GREY, _PALETTE) or (colour == _GREY and depth != 8):
                raise ValueError(f"{path} is no indexed PNG (colour type {colour}, {depth} bits); its numbers are lost")
            body = body[:9] + bytes([_GREY]) + body[10:]
        if kind not in (b"PLTE", b"tRNS"):
            out += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    image = image_of(out, cv2.IMREAD_UNCHANGED, str(path))
    if image.dtype != np.uint8 or image.ndim != 2:
        raise ValueError(f"{path} is damaged; copy it again")
    return image // (255 // (2**depth - 1))  # fewer bits are spread over 0..255


def read_colours(path: Path) -> dict[str, tuple[int, int, int]]:
    """RGB of each class from colors.txt. Raises ValueError for a class that is not in CITYSCAPES_OF."""
    colours = {}
    for line, (name, *rgb) in _rows(path, "colors"):
        if name not in CITYSCAPES_OF:
            raise ValueError(f"vkitti2: {path}, line {line}: unknown class {name!r}; known: {', '.join(CITYSCAPES_OF)}")
        red, green, blue = _numbers(path, line, rgb, kind=int)
        if not 0 <= min(red, green, blue) <= max(red, green, blue) <= 255:
            raise ValueError(f"vkitti2: {path}, line {line}: {name} is {red} {green} {blue}; colours are 0..255")
        colours[name] = (red, green, blue)
    return colours


def read_intrinsics(path: Path) -> dict[tuple[int, int], Float[np.ndarray, "3 3"]]:
    """K by (frame, camera)."""
    by_frame = {}
    for line, row in _rows(path, "intrinsic"):
        frame, camera = _numbers(path, line, row[:2], kind=int)
        fu, fv, cu, cv = _numbers(path, line, row[2:], kind=float)
        intrinsics = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
        _add(by_frame, (frame, camera), intrinsics, path=path, line=line)
    return by_frame


def read_extrinsics(path: Path) -> dict[tuple[int, int], Float[np.ndarray, "4 4"]]:
    """`cam_from_world` by (frame, camera)."""
    extrinsics = {}
    for line, row in _rows(path, "extrinsic"):
        frame, camera = _numbers(path, line, row[:2], kind=int)
        cam_from_world = np.array(_numbers(path, line, row[2:], kind=float)).reshape(4, 4)
        check_rigid(cam_from_world, f"vkitti2: {path}, line {line}", apart_m=WORLD_M)
        if cam_from_world[3].tolist() != [0, 0, 0, 1]:
            raise ValueError(f"vkitti2: {path}, line {line} must end with 0 0 0 1; copy it again")
        _add(extrinsics, (frame, camera), cam_from_world, path=path, line=line)
    return extrinsics


def read_objects(folder: Path) -> dict[tuple[int, int], list[VirtualObject]]:
    """Vehicles by (frame, camera), the hidden and the far ones too, from pose.txt, bbox.txt and info.txt."""
    kinds = {}
    for line, (track, label, *_) in _rows(folder / "info.txt", "info"):
        if label not in OBJECT_KINDS:
            raise ValueError(
                f"vkitti2: {folder / 'info.txt'}, line {line}: unknown label {label!r}; known: {OBJECT_KINDS}"
            )
        (key,) = _numbers(folder / "info.txt", line, [track], kind=int)
        _add(kinds, key, label, path=folder / "info.txt", line=line)
    boxes = {}
    for line, row in _rows(folder / "bbox.txt", "bbox"):
        key = tuple(_numbers(folder / "bbox.txt", line, row[:3], kind=int))
        # The last column says whether the object moves, which no label tells.
        box = _numbers(folder / "bbox.txt", line, row[3:-1], kind=float)
        _add(boxes, key, box, path=folder / "bbox.txt", line=line)
    objects: dict[tuple[int, int], list[VirtualObject]] = {}
    path = folder / "pose.txt"
    for line, row in _rows(path, "pose"):
        frame, camera, track = _numbers(path, line, row[:3], kind=int)
        _, width, height, length, *rest = _numbers(path, line, row[3:], kind=float)
        if (frame, camera, track) not in boxes or track not in kinds:
            raise ValueError(f"vkitti2: {path}, line {line}: track {track} is not in bbox.txt or info.txt; copy all")
        left, right, top, bottom, pixels, truncation, occupancy = boxes[frame, camera, track]
        objects.setdefault((frame, camera), []).append(
            VirtualObject(
                track=track,
                kind=kinds[track],
                size_m=(length, width, height),
                centre_m=(rest[6], rest[7], rest[8]),
                yaw_rad=rest[9],
                bbox_px=(left, top, right, bottom),
                pixels=int(pixels),
                truncation=truncation,
                occupancy=occupancy,
            )
        )
    return objects


def boxes_of(objects: list[VirtualObject], *, levels: tuple[float, float] = (0.5, 0.2)) -> Boxes:
    """KITTI's labels of the vehicles of which a pixel is seen.

    `occluded` is 1 from the first occupancy of `levels` on, 2 from the second, else 3; never 0, as the paper has it
    (no object of Virtual KITTI counts as wholly visible).
    """
    seen = [thing for thing in objects if thing.pixels > 0]

    def column(name: str, width: int) -> Float[np.ndarray, "n k"]:
        return np.array([getattr(thing, name) for thing in seen], np.float32).reshape(-1, width)

    occupancy = column("occupancy", 1)[:, 0]
    return Boxes(
        centre_m=column("centre_m", 3),
        size_m=column("size_m", 3),
        yaw_rad=column("yaw_rad", 1)[:, 0],
        bbox_px=column("bbox_px", 4),
        truncated=column("truncation", 1)[:, 0],
        occluded=np.where(occupancy >= levels[0], 1, np.where(occupancy >= levels[1], 2, 3)).astype(np.int32),
        kind=tuple(thing.kind for thing in seen),
    )


def _read(path: Path) -> np.ndarray:
    if not path.is_file():
        raise ValueError(f"vkitti2: there is no {path}; the frame needs it, copy it from the data set's archives")
    return read_pixels(path, cv2.IMREAD_UNCHANGED, by="vkitti2")


def _rows(path: Path, kind: str) -> list[tuple[int, list[str]]]:
    """Numbered lines below the header. Raises ValueError where the columns are not those of HEADERS."""
    if not path.is_file():
        raise ValueError(f"vkitti2: there is no {path}; copy it from the archive vkitti_2.0.3_textgt")
    header, *lines = read_text(path, by="vkitti2").splitlines() or [""]
    wanted = HEADERS[kind].split()
    if header.split()[:1] != wanted[:1] or len(header.split()) != len(wanted):
        raise ValueError(f"vkitti2: {path} begins with {header[:60]!r}; its header is {HEADERS[kind]!r}")
    rows = [(place, line.split()) for place, line in enumerate(lines, 2) if line.strip()]
    for place, row in rows:
        if len(row) != len(wanted):
            raise ValueError(f"vkitti2: {path}, line {place} has {len(row)} columns; it must have {len(wanted)}")
    return rows


def _numbers(path: Path, line: int, texts: list[str], *, kind: type[int] | type[float]) -> list:
    values = [parse_number(text, kind, where=f"vkitti2: {path}, line {line}") for text in texts]
    if not np.isfinite(values).all():
        raise ValueError(f"vkitti2: {path}, line {line} holds NaN or infinite numbers; copy it again")
    if np.abs(values).max(initial=0) > MOST_NUMBER:
        raise ValueError(f"vkitti2: {path}, line {line} holds a number beyond {MOST_NUMBER:g}; copy it again")
    return values


def _add(table: dict[Any, Any], key: Any, value: Any, *, path: Path, line: int) -> None:
    """Adds a line's entry. Raises ValueError where an earlier line has it: one of the two would be passed over."""
    if key in table:
        raise ValueError(f"vkitti2: {path}, line {line} is of {key}, which an earlier line has; copy it again")
    table[key] = value
