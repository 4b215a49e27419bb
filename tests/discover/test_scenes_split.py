import numpy as np
import pytest

from jaxsim.discover.name.select import LEVEL
from jaxsim.discover.scenes import FEWEST, folds, p_value, split

NAMES = [f"drive {k}" for k in range(16)]


def test_a_third_of_the_scenes_is_kept_for_judging_and_none_serves_twice():
    parts = split(NAMES)
    assert len(parts.judge) == 5
    assert sorted([*parts.find, *parts.judge]) == sorted(NAMES)


def test_the_same_scenes_always_divide_alike():
    assert split(NAMES) == split(NAMES[::-1])


def test_the_hash_changes_with_the_division():
    assert split(NAMES).sha256 != split(NAMES[:-1]).sha256


def test_too_few_scenes_are_an_error_that_says_how_many_are_needed():
    with pytest.raises(ValueError, match=r"9 independent scenes; a verdict needs 10"):
        split(NAMES[:9])


def test_frames_of_a_scene_are_fitted_or_held_out_together():
    unit = np.repeat(np.arange(7), 3)
    for fitted in folds(unit, 3):
        for u in range(7):
            assert len(set(fitted[unit == u])) == 1
    assert (folds(unit, 3) == 0).sum(0).tolist() == [1] * 21


def test_the_fewest_scenes_are_those_with_which_naming_can_pass_its_test():
    def best(scenes):
        find = np.ones(len(split(NAMES[:scenes]).find))
        return 2 * p_value(find)  # the better of two tests

    assert best(FEWEST) <= LEVEL
    assert 2 * p_value(np.ones(FEWEST - 1 - round((FEWEST - 1) / 3))) > LEVEL
