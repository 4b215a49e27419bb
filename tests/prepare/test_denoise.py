import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxsim.prepare import denoise
from jaxsim.prepare.denoise import METHODS
from tests.prepare.made_denoise import noisy

SHAPE = (24, 60)


def test_none_changes_nothing_but_cells_without_return():
    _, intensity = noisy()
    valid = np.random.default_rng(1).random(SHAPE) < 0.7
    np.testing.assert_array_equal(denoise(intensity, valid), np.where(valid, intensity, 0))


@pytest.mark.parametrize("method", METHODS)
def test_a_cell_without_return_is_no_black_one(method):
    clean, intensity = noisy()
    valid = np.random.default_rng(2).random(SHAPE) < 0.6
    with_garbage = np.where(valid, intensity, np.random.default_rng(3).random(SHAPE)).astype(np.float32)
    smooth = denoise(np.where(valid, intensity, 0).astype(np.float32), valid, method)
    np.testing.assert_array_equal(smooth, denoise(with_garbage, valid, method))
    assert (smooth[~valid] == 0).all()
    # Black neighbours would pull the mean down by 40 %.
    assert smooth[valid].mean() == pytest.approx(clean[valid].mean(), abs=0.02)


@given(
    hnp.arrays(np.float32, (8, 11), elements=st.floats(0, 1, width=32)),
    hnp.arrays(bool, (8, 11)),
    st.sampled_from(sorted(METHODS)),
)
@settings(max_examples=30, deadline=None)
def test_stays_within_what_was_measured_and_leaves_its_input_alone(intensity, valid, method):
    before = intensity.copy()
    smooth = denoise(intensity, valid, method)
    np.testing.assert_array_equal(intensity, before)
    assert smooth.dtype == np.float32
    if valid.any():
        low, high = intensity[valid].min() - 1e-4, intensity[valid].max() + 1e-4
        assert ((smooth[valid] >= low) & (smooth[valid] <= high)).all()
    assert not smooth[~valid].any()


def test_an_unknown_method_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="no method 'bm3d'; known: none, non_local_means, lidia"):
        denoise(np.zeros((4, 4), np.float32), np.ones((4, 4), bool), "bm3d")


def test_non_local_means_takes_noise_and_leaves_edges():
    clean, intensity = noisy()
    smooth = denoise(intensity, np.ones(SHAPE, bool), "non_local_means")
    assert np.abs(smooth - clean).mean() < 0.4 * np.abs(intensity - clean).mean()
    assert (smooth[:, 31] - smooth[:, 28] > 0.35).all()
