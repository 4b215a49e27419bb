"""Intervals over scenes."""

import numpy as np
import pytest

from jaxsim.metrics.intervals import (
    half_width,
    jackknife_half_width,
    jackknife_interval,
    known_mean,
    mean_interval,
    ratio_interval,
)
from jaxsim.metrics.paired import difference_of, frame_sums, scene_intervals

SHAPE = (8, 60)


def test_intervals_over_scenes_are_those_of_equal_scenes_means():
    """Scenes of equally many cells: the jackknife of the mean is Student's t of their means."""
    random = np.random.default_rng(0)
    truth = np.full(SHAPE, 0.5, np.float32)
    every = np.ones(SHAPE, bool)
    off = random.uniform(0.02, 0.1, 5).astype(np.float32)
    frames = [frame_sums(truth + x, ~every, y=truth, returned=every, m=every) for x in off]
    scenes = list("abcde")
    np.testing.assert_allclose(scene_intervals(frames, scenes)["mae"], mean_interval(off.astype(float)), rtol=1e-4)
    assert scene_intervals(frames, ["a"] * 5) == {}
    value, low, high = difference_of(frames, frames[::-1], scenes)
    assert value == pytest.approx(0, abs=1e-9)
    assert low < 0 < high
    # The same difference in every scene has no scatter, however scenes differ.
    more = [frame_sums(truth + x + 0.01, ~every, y=truth, returned=every, m=every) for x in off]
    assert difference_of(more, frames, scenes) == pytest.approx((0.01, 0.01, 0.01), rel=1e-3)


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


@pytest.mark.parametrize("scenes", [4, 8])
def test_the_interval_of_a_ratio_covers_about_as_often(scenes):
    rng = np.random.default_rng(scenes)
    covered = 0
    for _ in range(2000):
        room = rng.normal(1.0, 0.15, scenes)
        low, high = ratio_interval(0.8 * room + rng.normal(0, 0.1, scenes), room)
        covered += low <= 0.8 <= high
    assert covered / 2000 == pytest.approx(0.9, abs=0.03)


def test_entries_that_are_missing_do_not_count():
    scenes = np.array([[1.0, np.nan], [2.0, np.nan], [3.0, 4.0], [np.nan, np.nan]])
    width = half_width(scenes)
    np.testing.assert_allclose(width[0], half_width(scenes[:3, 0]))
    assert np.isnan(width[1])
    assert np.isnan(mean_interval(np.full(3, np.nan))).all()
    assert np.isnan(ratio_interval(np.array([1.0]), np.array([2.0]))).all()


def test_the_band_of_fits_that_share_scenes_covers_their_mean():
    rng = np.random.default_rng(3)
    covered = 0
    for _ in range(3000):
        scenes = rng.normal(0.0, 1.0, (3, 4)).mean(1)  # three groups of four scenes
        fits = (scenes.sum() - scenes) / 2  # each of two groups
        covered += abs(fits.mean()) <= float(jackknife_half_width(fits))
    assert covered / 3000 == pytest.approx(0.9, abs=0.02)


def test_what_no_scene_has_has_no_mean_and_what_one_alone_has_no_interval():
    assert known_mean(np.array([1.0, np.nan, 3.0])) == 2
    assert np.isnan(known_mean(np.full(3, np.nan)))
    assert np.isnan(mean_interval(np.full(3, np.nan))).all()
    assert np.isnan(ratio_interval(np.array([1.0, 2.0, 3.0]), np.array([0.0, 4.0, 0.0]))).all()
    assert np.isnan(jackknife_interval(30.0, np.array([29.0, np.inf, 31.0]))).all()
