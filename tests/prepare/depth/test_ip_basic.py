"""IP-Basic against the published program."""

import numpy as np
import pytest

from jaxsim.prepare.depth import METHODS, complete_depth, fill_in_fast, fill_in_multiscale

VARIANTS = [
    (name, extrapolate, blur)
    for name in ("fast", "multiscale")
    for extrapolate in (False, True)
    for blur in ("bilateral", "gaussian")
]


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
