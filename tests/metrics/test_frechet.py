from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg

from jaxsim.metrics.frechet import (
    Moments,
    frechet_distance,
    frechet_distance_of,
    frechet_score,
    halves,
    load_halves,
    save_halves,
    statistics_file,
)

CASES = {
    "d64_n300": ((751, 752), 300, 64, 0, (0.3, 1.0), (0.4, 1.1)),
    "d64_n40_singular": ((753, 754), 40, 64, 0, (0.3, 1.0), (0.4, 1.1)),
    "d64_rank10_n300_singular": ((755, 756), 300, 64, 10, (0.3, 1.0), (0.4, 1.1)),
    "d64_same": ((757, 757), 300, 64, 0, (0.3, 1.0), (0.3, 1.0)),
    "d2048_n300_singular": ((758, 759), 300, 2048, 0, (0.3, 0.4), (0.32, 0.44)),
}
"""Of the golden README: seeds, images, features, rank (0 full), shift and scale of both sets."""


def drawn(seed: int, n: int, d: int, rank: int, shift: float, scale: float) -> np.ndarray:
    r = np.random.default_rng(seed)
    k = rank or d
    z = r.standard_normal((n, k))
    x = z @ (r.standard_normal((k, d)) / np.sqrt(k)) * scale + shift
    return x if rank else np.maximum(x, 0)


def direct(x: np.ndarray, y: np.ndarray) -> float:
    """The formula as it stands, with SciPy's matrix root."""
    a, b = np.cov(x, rowvar=False), np.cov(y, rowvar=False)
    root = scipy.linalg.sqrtm(a @ b)
    step = x.mean(0) - y.mean(0)
    return float(step @ step + np.trace(a) + np.trace(b) - 2 * np.trace(root).real)


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_distances_equal_the_golden_ones(case, golden):
    with np.load(golden / "inception_fid" / "frechet.npz") as archive:
        want = {part: float(archive[f"{case}__{part}"]) for part in ("fid", "svd_form", "trace1", "trace2")}
    seeds, n, d, rank, *sides = CASES[case]
    a, b = (
        Moments.of(drawn(seed, n, d, rank, shift, scale)) for seed, (shift, scale) in zip(seeds, sides, strict=True)
    )
    assert np.trace(a.covariance) == pytest.approx(want["trace1"], rel=1e-10)
    got = frechet_distance(a, b)
    if case == "d64_same":
        assert abs(got) < 1e-11
        return
    tolerance = 1e-6 if "singular" in case else 1e-10
    assert got == pytest.approx(want["fid"], rel=tolerance)
    assert got == pytest.approx(want["svd_form"], rel=1e-8)


def test_a_regular_distance_equals_the_formula_with_scipy_s_root():
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((90, 12)), 0.7 * rng.standard_normal((70, 12)) + 0.2
    assert frechet_distance(Moments.of(x), Moments.of(y)) == pytest.approx(direct(x, y), rel=1e-9)


def test_the_distance_straight_from_few_samples_is_the_same():
    rng = np.random.default_rng(5)
    for n, m in ((9, 7), (60, 80)):
        x, y = rng.standard_normal((n, 30)), 1.3 * rng.standard_normal((m, 30)) - 0.1
        assert frechet_distance_of(x, y) == pytest.approx(frechet_distance(Moments.of(x), Moments.of(y)), rel=1e-9)
    with pytest.raises(ValueError, match="1 and 80 samples; one has no covariance"):
        frechet_distance_of(x[:1], y)


def test_moments_come_out_alike_however_the_images_arrive():
    x = np.random.default_rng(1).standard_normal((57, 5)) * 100 + 1e4
    for sizes in ((57,), (10, 10, 10, 27), (1,) * 57):
        edges = np.cumsum((0, *sizes))
        parts = [x[a:b].astype(np.float64) for a, b in pairwise(edges)]
        got = halves(parts).whole
        assert got.count == 57
        np.testing.assert_allclose(got.mean, x.mean(0), rtol=1e-12)
        np.testing.assert_allclose(got.covariance, np.cov(x, rowvar=False), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(halves([x]).even.mean, x[::2].mean(0), rtol=1e-12)


def test_a_set_without_any_spread_is_a_point():
    flat, other = Moments.of(np.ones((5, 3))), Moments.of(np.full((4, 3), 3.0))
    assert frechet_distance(flat, other) == pytest.approx(12.0)
    assert frechet_distance(flat, flat) == 0


def test_fewer_images_than_features_are_an_error():
    x = np.random.default_rng(2).standard_normal((40, 64))
    with pytest.raises(ValueError, match=r"fid: 40 frames to judge, 64 features.*at least 65 frames"):
        frechet_score(halves([x]), halves([x]), name="fid")


def test_the_score_at_half_the_images_shows_the_small_sample_s_bias():
    rng = np.random.default_rng(3)
    x, y = (rng.standard_normal((400, 20)) for _ in range(2))
    score = frechet_score(halves([x]), halves([y]), name="frechet_random")
    assert score.counts == (400, 400)
    # Both sets are of one law: the distance is all bias, and half the images double it.
    assert score.half is not None
    assert 1.6 < score.half / score.value < 2.6


def test_features_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="not finite"):
        Moments.of(np.array([[np.nan, 1.0]]))
    with pytest.raises(ValueError, match="0 images"):
        halves([])
    with pytest.raises(ValueError, match="two or more"):
        halves([np.ones((1, 3))])


def test_statistics_are_kept_for_one_network_and_one_data_set(tmp_path):
    parts = halves([np.random.default_rng(4).standard_normal((9, 3))])
    path = statistics_file(tmp_path, extractor="inception_torchvision-64-abcd", data="synthetic-1234")
    assert path.name == "frechet-inception_torchvision-64-abcd-synthetic-1234.npz"
    assert load_halves(path, extractor="e", data="d") is None
    save_halves(path, parts, extractor="e", data="d")
    kept = load_halves(path, extractor="e", data="d")
    assert kept is not None
    np.testing.assert_array_equal(kept.odd.scatter, parts.odd.scatter)
    assert kept.whole.count == 9
    with pytest.raises(ValueError, match="holds statistics of"):
        load_halves(path, extractor="another", data="d")
    path.write_bytes(b"broken")
    with pytest.raises(ValueError, match="delete it"):
        load_halves(path, extractor="e", data="d")
