"""Intervals cover as often as they say, also of few scenes."""

import numpy as np
import pytest

from jaxsim.discover.scenes import difference_interval, fold_half_width, half_width, mean_interval, ratio_interval


@pytest.mark.parametrize("scenes", [2, 3, 5, 20])
def test_the_interval_of_a_mean_covers_nine_times_in_ten(scenes):
    rng = np.random.default_rng(scenes)
    found = [mean_interval(rng.normal(1.0, 0.5, scenes)) for _ in range(3000)]
    assert np.mean([low <= 1.0 <= high for low, high in found]) == pytest.approx(0.9, abs=0.02)


def test_the_percentile_bootstrap_of_five_scenes_would_be_too_narrow():
    rng = np.random.default_rng(0)
    scenes = rng.normal(0.0, 1.0, (2000, 5))
    means = scenes[:, rng.integers(0, 5, (1000, 5))].mean(-1)
    low, high = np.quantile(means, [0.05, 0.95], axis=1)
    assert np.mean((low <= 0) & (high >= 0)) == pytest.approx(0.77, abs=0.03)


@pytest.mark.parametrize(("first", "second", "scatter"), [(5, 5, 1.0), (4, 11, 0.2), (11, 5, 0.2)])
def test_the_interval_of_a_difference_covers_nine_times_in_ten_also_where_scatters_differ(first, second, scatter):
    rng = np.random.default_rng(first)
    groups = [(rng.normal(1.0, 1.0, first), rng.normal(0.4, scatter, second)) for _ in range(3000)]
    intervals = np.array([difference_interval(*pair) for pair in groups])
    covered = (intervals[:, 0] <= 0.6) & (intervals[:, 1] >= 0.6)
    assert covered.mean() == pytest.approx(0.9, abs=0.02)


def test_the_interval_of_a_difference_without_scatter_is_a_point():
    assert difference_interval(np.full(3, 0.5), np.full(4, 0.25)) == (0.25, 0.25)
    assert np.isnan(difference_interval(np.ones(1), np.ones(4))).all()


@pytest.mark.parametrize("scenes", [4, 8])
def test_the_interval_of_a_ratio_covers_about_as_often(scenes):
    rng = np.random.default_rng(scenes)
    covered = 0
    for _ in range(2000):
        room = rng.normal(1.0, 0.15, scenes)
        low, high = ratio_interval(0.8 * room + rng.normal(0, 0.1, scenes), room)
        covered += low <= 0.8 <= high
    assert covered / 2000 == pytest.approx(0.9, abs=0.03)


def test_the_band_of_fits_that_share_scenes_covers_their_mean():
    rng = np.random.default_rng(3)
    covered = 0
    for _ in range(3000):
        scenes = rng.normal(0.0, 1.0, (3, 4)).mean(1)  # three groups of four scenes
        fits = (scenes.sum() - scenes) / 2  # each of two groups
        covered += abs(fits.mean()) <= fold_half_width(fits[:, None])[0]
    assert covered / 3000 == pytest.approx(0.9, abs=0.02)


def test_entries_that_are_missing_do_not_count():
    scenes = np.array([[1.0, np.nan], [2.0, np.nan], [3.0, 4.0], [np.nan, np.nan]])
    width = half_width(scenes)
    np.testing.assert_allclose(width[0], half_width(scenes[:3, 0]))
    assert np.isnan(width[1])
    assert np.isnan(mean_interval(np.full(3, np.nan))).all()
    assert np.isnan(ratio_interval(np.array([1.0]), np.array([2.0]))).all()
