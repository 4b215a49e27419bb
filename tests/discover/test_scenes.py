"""Scenes are divided once and for all, chance is paid for, and intervals cover as often as they say."""

import numpy as np
import pytest
from scipy.stats import false_discovery_control, spearmanr

from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import (
    attainable,
    best_of_gains,
    chance_of,
    clipped,
    difference_interval,
    false_discovery_rates,
    folds,
    p_value,
    rank_correlation,
    scene_means,
    split_scenes,
)

NAMES = [f"drive {k}" for k in range(16)]


def test_a_third_of_the_scenes_is_kept_for_judging_and_none_serves_twice():
    parts = split_scenes(NAMES)
    assert len(parts.judge) == 5
    assert sorted([*parts.find, *parts.judge]) == sorted(NAMES)


def test_a_scene_is_the_mean_of_what_its_frames_know():
    nan = np.nan
    frames = [("a", [1.0, nan, nan]), ("b", [4.0, 5.0, nan]), ("a", [3.0, 2.0, nan])]
    table = scene_means((scene, np.array(numbers)) for scene, numbers in frames)
    np.testing.assert_array_equal(table, [[2.0, 2.0, nan], [4.0, 5.0, nan]])


def test_the_same_scenes_always_divide_alike():
    assert split_scenes(NAMES) == split_scenes(NAMES[::-1])


def test_the_hash_changes_with_the_division():
    assert split_scenes(NAMES).sha256 != split_scenes(NAMES[:-1]).sha256


def test_too_few_scenes_are_an_error_that_says_how_many_are_needed():
    with pytest.raises(ValueError, match=r"9 independent scenes; a verdict needs 10"):
        split_scenes(NAMES[:9])


def test_frames_of_a_scene_are_fitted_or_held_out_together():
    scene = np.repeat(np.arange(7), 3)
    for in_fit in folds(scene, 3):
        for u in range(7):
            assert len(set(in_fit[scene == u])) == 1
    assert (folds(scene, 3) == 0).sum(0).tolist() == [1] * 21


def test_the_fewest_scenes_are_those_with_which_naming_can_pass_its_test():
    def best(scenes):
        find = np.ones(len(split_scenes(NAMES[:scenes]).find))
        return 2 * p_value(find)  # the better of two tests

    assert best(RULES.fewest_scenes) <= RULES.agreement_level
    assert 2 * p_value(np.ones(RULES.fewest_scenes - 1 - round((RULES.fewest_scenes - 1) / 3))) > RULES.agreement_level


def test_sign_flips_give_the_exact_probability_of_agreeing_scenes():
    assert p_value(np.ones(10)) == pytest.approx(1 / 1024)
    assert p_value(np.zeros(10)) == 1


@pytest.mark.parametrize("size", [1e-13, 1.0, 1e4, 1e9])
def test_what_was_measured_reaches_itself_however_large_it_is(size):
    """Rounding, which grows with the gains, made it nothing, and small gains all alike."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        assert p_value(size * rng.normal(2105, 100, 10)) == 2**-10
    few = np.zeros(12)
    few[[0, 5, 8, 9]] = [13611.1, 3516.2, 17382.7, 13366.4]
    assert p_value(size * few) == 2**-4


def test_of_few_scenes_the_level_is_what_their_perfect_agreement_reaches():
    assert p_value(np.ones(3)) > RULES.repeats_judge_level
    assert p_value(np.ones(3)) <= attainable(RULES.repeats_judge_level, 3) < p_value(np.array([1, 1, 1e-3, -1e-3]))
    assert attainable(RULES.repeats_judge_level, 10) == RULES.repeats_judge_level


def test_the_best_of_many_gains_is_held_against_the_best_that_chance_makes():
    rng = np.random.default_rng(9)
    gains = rng.normal(-0.5, 1, (30, 12))
    assert best_of_gains(gains)[1] > 0.05
    gains[4] = rng.normal(4, 1, 12)
    best, p = best_of_gains(gains)
    assert best == 4
    assert p < 0.01


def test_two_scenes_cannot_decide():
    gain = np.array([900.0, 800.0, 3.0, -1.0, -2.0, -1.0, 1.0, -400.0, 2.0, -1.0, -2.0])
    assert clipped(gain).max() == 400.0
    assert clipped(gain).min() == -400.0
    assert clipped(gain).sum() < 410


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


@pytest.mark.parametrize("values", [1000, 4])
def test_correlations_of_ranks_are_spearmans_with_ties_too(values):
    first, second = np.random.default_rng(values).integers(0, values, (2, 50)).astype(float)
    assert rank_correlation(first, first + second) == pytest.approx(spearmanr(first, first + second)[0], abs=1e-12)


def test_what_every_third_drive_has_is_not_all_in_one_fold():
    scenes = np.arange(12)
    held_out = folds(scenes, 3) == 0
    for first in range(3):
        assert (held_out[:, first::3].sum(1) > 0).sum() >= 2
    # Each fold holds out one of every three in a row.
    assert (held_out.reshape(3, 4, 3).sum(2) == 1).all()


@pytest.mark.parametrize("count", [0, 1, 2, 40])
def test_false_discovery_rates_are_scipys(count):
    p = np.random.default_rng(count).uniform(0, 1, count).round(2)
    expected = false_discovery_control(p) if count else p
    np.testing.assert_allclose(false_discovery_rates(p), expected, rtol=1e-12)


def test_a_gain_that_is_no_number_shows_nothing():
    gains = np.array([3.0, 2.0, np.nan, 4.0, 5.0, 3.0])
    assert p_value(gains) == 1
    assert chance_of(np.zeros(99), np.nan) == 1
    assert best_of_gains(np.stack([gains, np.ones(6)]))[1] == 1
