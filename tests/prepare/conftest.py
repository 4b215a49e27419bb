"""Fixtures that test files share."""

import cv2
import numpy as np
import pytest


@pytest.fixture(scope="module")
def sparse(golden):
    image = cv2.imread(str(golden / "ip_basic/sparse_000000_uint16x256.png"), cv2.IMREAD_UNCHANGED)
    depth = image.astype(np.float32) / np.float32(256)
    return depth, depth > 0
