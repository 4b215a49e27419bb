"""PNG files whose pixels are numbers, not colours."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE = 0, 3


def read_indexed(path: Path) -> UInt8[np.ndarray, "h w"]:
    """The palette index of every pixel of an indexed PNG, or the values of an 8-bit grey one.

    OpenCV would give the palette's colours; told that the file is grey, it gives the indices.
    Raises ValueError for any other file. Source: PNG specification, 4.1 and 11.2.
    """
    data = path.read_bytes()
    if not data.startswith(_SIGNATURE):
        raise ValueError(f"{path} is no PNG; copy it again")
    out = _SIGNATURE
    at = len(_SIGNATURE)
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
    image = cv2.imdecode(np.frombuffer(out, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint8 or image.ndim != 2:
        raise ValueError(f"{path} is damaged; copy it again")
    return image // (255 // (2**depth - 1))  # fewer bits are spread over 0..255
