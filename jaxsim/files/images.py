"""Images in PNG and JPEG: measured by their headers before they are unpacked."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

from jaxsim.files.whole import check_size, replacing

MOST_PIXELS = 2**26
"""Of an image: eight times the largest that a car's cameras and renderers of their views make."""
MOST_BYTES = 512 * 2**20
PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_SCAN = 0xDA


def read_pixels(path: Path | str, flags: int, *, by: str) -> np.ndarray:
    """An image file as OpenCV decodes it with these flags (cv2.IMREAD_...).

    Raises ValueError where it is neither PNG nor JPEG, is cut off or damaged, or has more pixels than MOST_PIXELS.
    """
    check_size(path, by=by, most=MOST_BYTES)
    return image_of(Path(path).read_bytes(), flags, f"{by}: {path}")


def image_of(data: bytes, flags: int, where: str) -> np.ndarray:
    """The image of a file's bytes. Raises ValueError as `read_pixels`, beginning with `where`."""
    check_image_file(data, where)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise ValueError(f"{where} is not an image that can be read; copy it again")
    return image


def check_image_file(data: bytes, where: str) -> None:
    """Raises ValueError as `read_pixels`, without unpacking anything."""
    try:
        rows, columns = _png_size(data) if data.startswith(PNG) else _jpeg_size(data)
    except (struct.error, IndexError, ValueError) as error:
        why = error if isinstance(error, ValueError) else "it is cut off"
        raise ValueError(f"{where} is not an image that can be read ({why}); copy it again") from None
    if rows * columns > MOST_PIXELS:
        raise ValueError(f"{where} is an image of {columns} x {rows} pixels; no camera's has more than {MOST_PIXELS}")


def _png_size(data: bytes) -> tuple[int, int]:
    """Rows and columns. Raises ValueError where a chunk is cut off or differs from its CRC. Source: PNG, 5.3, 11.2."""
    at, kind = len(PNG), b""
    while kind != b"IEND":
        (length,), kind = struct.unpack_from(">I", data, at), data[at + 4 : at + 8]
        body_end = at + 8 + length
        (crc,) = struct.unpack_from(">I", data, body_end)
        if zlib.crc32(data[at + 4 : body_end]) != crc:
            raise ValueError("a chunk of the PNG is damaged")
        at = body_end + 4
    columns, rows = struct.unpack_from(">II", data, len(PNG) + 8)
    return rows, columns


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """Rows and columns. Raises ValueError where it is no JPEG, or its end is missing. Source: ITU-T T.81, B.1, B.2."""
    if not data.startswith(_JPEG):
        raise ValueError("neither PNG nor JPEG")
    rows = columns = marker = 0
    at = len(_JPEG)
    while marker != _SCAN:
        while data[at] == 0xFF:
            at += 1
        marker, (length,) = data[at], struct.unpack_from(">H", data, at + 1)
        # Start of frame: all of C0..CF but the tables DHT, JPG and DAC.
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            rows, columns = struct.unpack_from(">HH", data, at + 4)
        at += 1 + length
    # Before the scan a thumbnail may have an end of its own, and behind the image's end bytes of others may follow.
    if data.find(b"\xff\xd9", at) < 0:
        raise ValueError("the JPEG is cut off")
    return rows, columns


def write_image(path: Path | str, rgb: np.ndarray, *, by: str) -> Path:
    """Writes red, green and blue in the format of the path's suffix, whole or not at all; gives its path."""
    # OpenCV has blue first; it encodes, and does not write, for of a disk that is full it would say nothing.
    done, data = cv2.imencode(Path(path).suffix, np.ascontiguousarray(rgb[..., ::-1]))
    if not done:
        raise OSError(f"{by}: could not write {path}")
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())
    return Path(path)
