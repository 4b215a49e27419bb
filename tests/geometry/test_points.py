"""What the points of a LiDAR's cloud can be."""

import numpy as np
import pytest

from jaxsim.geometry.points import FAR_M, PAGE_BYTES, check_end, check_points

GOOD = np.array([[1.0, 2.0, 0.5, 0.0], [-FAR_M, 0.0, 0.0, 1.0]])


def test_points_up_to_the_farthest_and_the_whole_scale_of_intensity_pass():
    check_points(GOOD, "a.bin")
    check_points(GOOD[:, :3], "a.bin")


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (GOOD[:, :2], r"a\.bin: a cloud of shape \(2, 2\)"),
        (GOOD[:0], "holds no points"),
        (GOOD * [[np.nan, 1, 1, 1], [1, 1, 1, 1]], "1 of 2 points are NaN"),
        (GOOD * [1.001, 1, 1, 1], "must be in metres"),
        (0 * GOOD, r"all 2 points lie within 0\.001 m of the sensor"),
        (np.frombuffer(b"1.0 2.0 3.0 0.5\n" * 2, "<f4").reshape(2, 4), "of another kind .text, labels."),
        (GOOD * [1, 1, 1, 255], r"intensity spans 0\.\.255"),
    ],
)
def test_what_no_lidar_sees_is_told(points, message):
    with pytest.raises(ValueError, match=message):
        check_points(points, "a.bin")


def test_a_page_of_zeros_at_the_end_was_never_written_and_rays_without_return_were():
    x = np.arange(1.0, 1001.0)
    few, many = PAGE_BYTES // 16 - 1, PAGE_BYTES // 16
    check_end([np.where(x > 1000 - few, 0, x), 0 * x], record_bytes=16)
    lost = np.where(x > 1000 - many, 0, x)
    with pytest.raises(ValueError, match="from number 744 of 1000 on are zeros alone"):
        check_end([lost, 0 * x], record_bytes=16)
    check_end([lost, 0 * x + 1], record_bytes=16)
    lost[3] = 0
    check_end([lost, 0 * x], record_bytes=16)
