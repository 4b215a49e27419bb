import numpy as np
import pytest

from jaxsim.prepare.depth import METHODS, complete_depth, through_points


def test_an_unknown_method_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="known: ip_basic, ip_basic_fast; penet also takes the image"):
        complete_depth(np.ones((8, 8), np.float32), np.ones((8, 8), bool), "cspn")


def road(lines_px=(3.6, 4.0, 3.2, 4.4), camera_m=1.65, focal=721.5, rows=140):
    """Points on a flat road, on image rows as far apart as lines of an HDL-64E are, and the road's depth everywhere."""
    row = np.arange(rows)
    truth = np.broadcast_to((camera_m * focal / (row + 20.5))[:, None], (rows, 90)).astype(np.float32)
    valid = np.zeros((rows, 90), bool)
    at, k = 10.0, 0
    while at < rows - 1:
        valid[round(at), k % 2 :: 2] = True
        at += lines_px[k % len(lines_px)]
        k += 1
    return truth, valid


@pytest.mark.parametrize("method", METHODS)
def test_dense_depth_goes_through_its_points(method):
    truth, valid = road()
    sparse = np.where(valid, truth, np.float32(0))
    dense, known = complete_depth(sparse, valid, method)
    led = through_points(dense, known, sparse, valid=valid)
    inner = valid.copy()
    inner[:15] = inner[-6:] = False
    before, after = (np.abs(x - truth)[inner] for x in (dense, led))
    assert before.max() > 0.2
    assert after.max() < 1e-3
    between = known & ~valid & (truth > 9) & (truth < 20)
    assert np.abs(led - truth)[between].mean() < np.abs(dense - truth)[between].mean()


def test_a_far_point_that_a_near_surface_has_grown_over_changes_nothing():
    near, far = np.full((30, 40), 8.0, np.float32), np.zeros((30, 40), bool)
    far[15, 20] = True
    sparse = np.where(far, np.float32(30), near)
    every = np.ones((30, 40), bool)
    np.testing.assert_array_equal(through_points(near, every, sparse, valid=far), near)
    np.testing.assert_array_equal(through_points(near, every, sparse, valid=np.zeros_like(far)), near)
