"""The sliced Wasserstein distance."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage
from scipy.stats import wasserstein_distance

from jaxsim.metrics.sliced_wasserstein import (
    _standardised,
    laplacian_pyramid,
    patches_at,
    pyramid_levels,
    sliced,
    sliced_wasserstein,
)


def pyramid_by_scipy(image: np.ndarray, levels: int) -> list[np.ndarray]:
    taps = np.array([1, 4, 6, 4, 1]) / 16

    def blur(x):
        for axis in (0, 1):
            x = ndimage.correlate1d(x, taps, axis=axis, mode="mirror")
        return x

    parts = [image]
    for _ in range(levels - 1):
        small = blur(parts[-1])[::2, ::2]
        wide = np.zeros(parts[-1].shape)
        wide[1::2, 1::2] = small
        parts[-1] = parts[-1] - 4 * blur(wide)
        parts.append(small)
    return parts


def test_the_pyramid_equals_one_made_with_scipy():
    image = np.random.default_rng(7).random((64, 96)).astype(np.float32)
    got = laplacian_pyramid(image[None, ..., None], levels=3)
    for level, want in zip(got, pyramid_by_scipy(image.astype(float), 3), strict=True):
        np.testing.assert_allclose(np.asarray(level)[0, ..., 0], want, atol=1e-5)
    assert [pyramid_levels(*size) for size in ((64, 512), (44, 372), (16, 16))] == [3, 2, 1]


def test_a_slice_s_distance_is_scipy_s_wasserstein_distance():
    rng = np.random.default_rng(8)
    a, b, directions = rng.random((50, 49)), rng.random((50, 49)) * 1.3, rng.standard_normal((49, 5))
    want = np.mean([wasserstein_distance(a @ d, b @ d) for d in directions.T])
    arrays = (jnp.asarray(x, jnp.float32) for x in (a, b, directions))
    assert float(sliced(*arrays)) == pytest.approx(want, rel=1e-5)


def test_patches_are_cut_where_they_are_said_to_lie_and_standardised_by_channel():
    image = np.arange(2 * 9 * 12 * 2, dtype=np.float32).reshape(2, 9, 12, 2)
    got = np.asarray(patches_at(image, jnp.array([0, 7])))
    np.testing.assert_array_equal(got[:, 1], image[:, 1:8, 1:8])  # six columns fit a patch: place 7 is (1, 1)
    flat = np.asarray(_standardised(got)).reshape(2, 2, 7, 7, 2)
    np.testing.assert_allclose(flat.mean((0, 1, 2, 3)), 0, atol=1e-5)
    np.testing.assert_allclose(flat.std((0, 1, 2, 3), ddof=1), 1, rtol=1e-4)


def test_swd_is_small_between_halves_of_one_law_and_large_between_two_laws():
    rng = np.random.default_rng(9)
    noise = rng.standard_normal((12, 32, 48, 2)).astype(np.float32)
    smooth = ndimage.gaussian_filter(noise, (0, 1.5, 1.5, 0)).astype(np.float32)
    same = sliced_wasserstein(noise[:6], noise[6:])
    other = sliced_wasserstein(noise[:6], smooth[6:])
    assert sorted(same) == ["swd_16", "swd_32", "swd_mean"]
    assert other["swd_mean"] > 1.4 * same["swd_mean"]
    assert sliced_wasserstein(noise[:6], noise[6:]) == same
    odd = sliced_wasserstein(noise[:6, :, :47], noise[6:, :, :47])
    assert odd["swd_mean"] < 2 * same["swd_mean"]
    with pytest.raises(ValueError, match="equally many"):
        sliced_wasserstein(noise[:6], noise[:5])
