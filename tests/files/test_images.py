"""Images are measured before they are unpacked."""

import struct
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest

from jaxsim.data.kitti_depth import read_kitti_depth
from jaxsim.data.kitti_files import read_image
from jaxsim.data.vkitti2_files import read_indexed
from jaxsim.files import image_of, read_pixels, write_image
from jaxsim.files.images import PNG

IMAGE = np.random.default_rng(0).integers(0, 255, (20, 30, 3)).astype(np.uint8)


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def huge(columns: int, rows: int) -> bytes:
    """A small PNG that says it is large; its rows would unpack to nothing but zeros."""
    about = chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0))
    return PNG + about + chunk(b"IDAT", zlib.compress(bytes(10**6))) + chunk(b"IEND", b"")


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_an_image_is_decoded_as_opencv_does(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), IMAGE)
    found = read_pixels(path, cv2.IMREAD_COLOR, by="test")
    np.testing.assert_array_equal(found, cv2.imread(str(path), cv2.IMREAD_COLOR))


def test_a_written_image_is_read_back_and_one_of_no_known_format_leaves_nothing(tmp_path):
    np.testing.assert_array_equal(read_image(write_image(tmp_path / "a.png", IMAGE, by="test")), IMAGE)
    with pytest.raises((OSError, cv2.error)):
        write_image(tmp_path / "a.nothing", IMAGE, by="test")
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize("read", [read_image, read_kitti_depth, read_indexed])
@pytest.mark.parametrize("size", [(40000, 40000), (2**31 - 1, 1), (8193, 8192)])
def test_a_png_of_40000_by_40000_is_refused_before_it_is_unpacked(tmp_path, read, size):
    (tmp_path / "a.png").write_bytes(huge(*size))
    tracemalloc.start()
    with pytest.raises(ValueError, match=rf"a\.png is an image of {size[0]} x {size[1]} pixels"):
        read(tmp_path / "a.png")
    assert tracemalloc.get_traced_memory()[1] < 2**24
    tracemalloc.stop()


def test_a_jpeg_ends_where_its_scan_does_whatever_stands_before_or_behind(tmp_path):
    path = tmp_path / "a.jpg"
    cv2.imwrite(str(path), IMAGE)
    whole = path.read_bytes()
    path.write_bytes(whole + bytes(4096))
    np.testing.assert_array_equal(read_image(path), image_of(whole, cv2.IMREAD_COLOR, "a")[..., ::-1])
    thumbnail = b"\xff\xe1" + struct.pack(">H", 2 + len(whole)) + whole
    path.write_bytes(whole[:2] + thumbnail + whole[2:-20])
    with pytest.raises(ValueError, match="the JPEG is cut off"):
        read_image(path)
