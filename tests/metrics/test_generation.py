"""LiDAR generation metrics beside SciPy, and the published programs' values."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.distance import cdist, jensenshannon
from scipy.stats import wasserstein_distance

from jaxsim.metrics.bev import COUNTS, counts, jensen_shannon, lidm_occupancy, mmd, spherical_image
from jaxsim.metrics.chamfer import LIDAR_ALPHA_PER_M2, chamfer
from jaxsim.metrics.sliced_wasserstein import (
    _standardised,
    laplacian_pyramid,
    levels_of,
    patches_at,
    sliced,
    sliced_wasserstein,
)


@pytest.fixture(scope="module")
def published(golden):
    folder = golden / "lidar_metrics"
    with np.load(folder / "clouds.npz") as archive:
        arrays = dict(archive)
    return arrays, json.loads((folder / "values.json").read_text())


def clouds(seed: int, n: int, points: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.standard_normal((n, points, 3)) * [20, 15, 1]).astype(np.float32)


def histograms(name: str, sets: np.ndarray) -> np.ndarray:
    return np.asarray(COUNTS[name](sets, np.ones(sets.shape[:-1], bool)))


def test_histograms_equal_the_published_ones(published):
    arrays, _ = published
    for side in ("ref", "gen"):
        got = histograms("r2dm", arrays[f"clouds_{side}"])
        assert np.abs(got - arrays[f"r2dm_hist_{side}"]).sum() <= 2
        total = histograms("lidargen", arrays[f"clouds_{side}"]).sum(0)
        assert np.abs(total - arrays[f"lidargen_hist_sum_{side}"]).sum() <= 4
    image, filled, _ = (np.asarray(x) for x in spherical_image(arrays["clouds_ref"][:1], np.ones((1, 1500), bool)))
    want = arrays["range_images_ref"]
    agree = np.isclose(np.where(filled, image, -1), want, atol=1e-3) | np.isclose(
        np.clip(np.log2(image + 1.0001) / 6, 0, 1), want, atol=1e-4
    )
    assert (~agree).sum() <= 4


def test_jsd_and_mmd_equal_the_published_values(published):
    arrays, values = published
    for name, tolerance in (("lidargen", 2e-4), ("r2dm", 1e-5)):
        a, b = (histograms(name, arrays[f"clouds_{side}"]) for side in ("gen", "ref"))
        assert jensen_shannon(a.sum(0), b.sum(0)) == pytest.approx(values[f"{name}_jsd"], rel=tolerance)
        want = values["r2dm_mmd_float64" if name == "r2dm" else "lidargen_mmd"]
        assert mmd(a, b, definition=name) == pytest.approx(want, rel=10 * tolerance)


def test_lidar_diffusion_s_scores_equal_the_published_values(published):
    arrays, values = published
    reference, generated = (list(arrays[f"clouds_{side}"]) for side in ("ref", "gen"))
    occupancy = [lidm_occupancy(side) for side in (reference, generated)]
    assert [float(o.sum()) for o in occupancy] == values["lidm_bev_sum"]
    assert jensen_shannon(*occupancy) == pytest.approx(values["lidm_jsd"], rel=1e-5)
    pairs = zip(reference[:3], generated[:3], strict=True)
    assert np.mean([chamfer(a, b).square_m2 for a, b in pairs]) == pytest.approx(values["lidm_cd_3d_first3"], rel=1e-5)


def test_counts_are_those_of_numpy_s_histogram():
    cloud = clouds(0, 2, 4000)
    valid = np.random.default_rng(1).random((2, 4000)) < 0.8
    got = np.asarray(counts(cloud, valid))
    for k in range(2):
        distance = np.linalg.norm(cloud[k], axis=1)
        kept = cloud[k][valid[k] & (distance > 3) & (distance < 70)]
        want, *_ = np.histogram2d(kept[:, 0], kept[:, 1], bins=100, range=[[-80, 80]] * 2)
        np.testing.assert_array_equal(got[k], want)


def test_jsd_equals_scipy_s():
    rng = np.random.default_rng(2)
    p, q = rng.poisson(0.4, (30, 30)).astype(float), rng.poisson(0.5, (30, 30)).astype(float)
    assert jensen_shannon(p, q) == pytest.approx(jensenshannon(p.ravel(), q.ravel()), rel=1e-9)
    assert jensen_shannon(p, p) == 0
    with pytest.raises(ValueError, match="empty"):
        jensen_shannon(p, 0 * q)


@pytest.mark.parametrize(("definition", "order"), [("lidargen", 2), ("r2dm", "fro")])
def test_mmd_equals_the_kernel_written_out(definition, order):
    a, b = (histograms("r2dm", clouds(seed, n, 900)).astype(np.float64) for seed, n in ((3, 4), (4, 3)))
    p, q = (h / h.sum((1, 2), keepdims=True) for h in (a, b))

    def kernel(x, y):
        return np.mean([[np.exp(-(np.linalg.norm(u - v, order) ** 2) / 0.5) for v in y] for u in x])

    want = kernel(p, p) + kernel(q, q) - 2 * kernel(p, q)
    assert mmd(a, b, definition=definition) == pytest.approx(want, rel=1e-4)
    with pytest.raises(ValueError, match="known: lidargen, r2dm"):
        mmd(a, b, definition="ultralidar")


def test_chamfer_equals_the_table_of_all_distances():
    a, b = clouds(5, 1, 300)[0], clouds(6, 1, 220)[0]
    table = cdist(a.astype(float), b.astype(float))
    got = chamfer(a, b)
    assert got.distance_m == pytest.approx((table.min(1).mean() + table.min(0).mean()) / 2)
    assert got.square_m2 == pytest.approx(((table**2).min(1).mean() + (table**2).min(0).mean()) / 2)
    # Density-aware, point by point.
    parts = []
    for t in (table, table.T):
        nearest = t.argmin(1)
        terms = [
            1 - np.exp(-LIDAR_ALPHA_PER_M2 * t[i, j] ** 2) * (t.shape[0] / t.shape[1]) / np.sum(nearest == j)
            for i, j in enumerate(nearest)
        ]
        parts.append(np.mean(terms))
    assert got.density_aware == pytest.approx(np.mean(parts))


def test_density_aware_chamfer_sees_clumps_that_chamfer_does_not():
    line = np.stack([np.linspace(0, 40, 200), np.zeros(200), np.zeros(200)], 1)
    clumped = line.copy()
    clumped[:100] = line[0]  # half of the points in one place
    assert chamfer(line, line).density_aware == pytest.approx(0)
    assert chamfer(clumped, line).density_aware > 0.4
    with pytest.raises(ValueError, match="empty"):
        chamfer(line, line[:0])


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
    assert [levels_of(*size) for size in ((64, 512), (44, 372), (16, 16))] == [3, 2, 1]


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
