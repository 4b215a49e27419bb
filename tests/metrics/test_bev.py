"""Histograms from above, and the scores that are made of them."""

import numpy as np
import pytest
from scipy.spatial.distance import jensenshannon

from jaxsim.metrics import bev
from jaxsim.metrics.bev import COUNTS, SQUARED_DISTANCES, cell_counts, jensen_shannon, mmd, spherical_image
from tests.metrics.made_generation import clouds
from tests.quick import quick_jit


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


def test_counts_are_those_of_numpy_s_histogram():
    cloud = clouds(0, 2, 4000)
    valid = np.random.default_rng(1).random((2, 4000)) < 0.8
    got = np.asarray(cell_counts(cloud, valid))
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


@pytest.mark.parametrize("few", [0, bev.FEW])
def test_spectral_distances_are_those_of_all_singular_values(few, monkeypatch):
    """Also where two directions are as long as each other, where none is, and within one set; of many by Lanczos'
    method."""
    monkeypatch.setattr(bev, "FEW", few)
    monkeypatch.setattr(bev, "_spectral_squares", quick_jit(bev._spectral_squares.__wrapped__))
    rng = np.random.default_rng(5)
    a, b = rng.random((5, 100, 100)) ** 8, rng.random((4, 100, 100)) ** 8
    a[1], a[2] = b[0] + np.eye(100) / 50, b[0]
    a, b = a / a.sum((1, 2), keepdims=True), b / b.sum((1, 2), keepdims=True)
    for x, y in ((a, b), (a, a), (a[:4], a[:4])):
        want = [[np.linalg.norm(one - other, 2) ** 2 for other in y] for one in x]
        np.testing.assert_allclose(SQUARED_DISTANCES["lidargen"](x, y), want, rtol=3e-5, atol=1e-16)
