import cv2
import numpy as np
import pytest

from jaxsim.prepare.depth import METHODS, complete_depth, fill_in_fast, fill_in_multiscale, through_points

VARIANTS = [
    (name, extrapolate, blur)
    for name in ("fast", "multiscale")
    for extrapolate in (False, True)
    for blur in ("bilateral", "gaussian")
]


@pytest.fixture(scope="module")
def sparse(golden):
    image = cv2.imread(str(golden / "ip_basic/sparse_000000_uint16x256.png"), cv2.IMREAD_UNCHANGED)
    depth = image.astype(np.float32) / np.float32(256)
    return depth, depth > 0


@pytest.mark.parametrize(("name", "extrapolate", "blur"), VARIANTS)
def test_equals_the_published_program(golden, sparse, name, extrapolate, blur):
    fill = {"fast": fill_in_fast, "multiscale": fill_in_multiscale}[name]
    depth, valid = fill(*sparse, extrapolate=extrapolate, blur=blur)
    values = np.load(golden / "ip_basic/samples_000000.npz")
    key = f"{name}_{'extrap' if extrapolate else 'noextrap'}_{blur}"
    expected = values[key]
    tolerance = 1e-4 if blur == "gaussian" else 2e-3
    np.testing.assert_allclose(depth.ravel()[values["pixels_flat"]], expected, atol=tolerance, rtol=0)
    count, total, largest, smallest = values[f"{key}_stats"]
    assert valid.sum() == count
    assert depth[valid].sum(dtype=np.float64) == pytest.approx(total, rel=1e-6)
    assert (depth.max(), depth.min()) == pytest.approx((largest, smallest), abs=tolerance)


@pytest.mark.parametrize("method", METHODS)
def test_leaves_its_input_alone(method):
    depth = np.zeros((40, 60), np.float32)
    depth[20:, ::5] = 12.5
    valid = depth > 0
    before = depth.copy(), valid.copy()
    complete_depth(depth, valid, method)
    np.testing.assert_array_equal(depth, before[0])
    np.testing.assert_array_equal(valid, before[1])


def test_values_outside_the_mask_are_never_read():
    depth = np.full((40, 60), np.nan, np.float32)
    valid = np.zeros((40, 60), bool)
    depth[20:, ::5], valid[20:, ::5] = 12.5, True
    dense, known = complete_depth(depth, valid)
    assert known[25:35].all()
    np.testing.assert_allclose(dense[known], 12.5, rtol=1e-5)


def test_without_extrapolation_the_sky_stays_empty():
    depth = np.zeros((60, 60), np.float32)
    depth[40:, ::4] = 20.0
    _, open_sky = complete_depth(depth, depth > 0)
    _, extended = fill_in_fast(depth, depth > 0, extrapolate=True)
    assert not open_sky[:20].any()
    assert extended.all()


def test_wide_gaps_between_lines_are_closed_by_the_multi_scale_form_alone():
    depth = np.zeros((80, 40), np.float32)
    depth[20::24] = 10.0
    _, closed = complete_depth(depth, depth > 0, "ip_basic")
    _, open_between = complete_depth(depth, depth > 0)
    assert closed[22:66].all()
    assert not open_between[30:34].any()
    assert open_between[20::24].all()


def test_an_empty_scan_says_so():
    with pytest.raises(ValueError, match="not one pixel has depth"):
        complete_depth(np.zeros((8, 8), np.float32), np.zeros((8, 8), bool))


def test_an_unknown_method_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="ip_basic, ip_basic_fast, penet"):
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
