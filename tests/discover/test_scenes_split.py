from itertools import pairwise

import numpy as np
import pytest

from jaxsim.discover.model.columns import FEWEST_COLUMNS, GUARD_COLUMNS, RAYS, SECTORS, blocks
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


def test_a_single_scan_is_cut_into_sectors_with_gaps_between():
    cut = blocks(["drive"], 64, 1024)
    assert len(set(cut.unit)) == SECTORS
    for left, right in zip(cut.column, cut.column[1:], strict=False):
        assert right.min() - left.max() > GUARD_COLUMNS


def test_a_narrow_single_scan_is_an_error():
    with pytest.raises(ValueError, match="too narrow"):
        blocks(["drive"], 64, 120)


@pytest.mark.parametrize("frames", [1, 2, 6, 200])
def test_frames_of_one_drive_are_cut_into_the_same_sectors(frames):
    cut = blocks(["drive"] * frames, 44, 372)
    assert cut.frame.tolist() == [f for f in range(frames) for _ in range(SECTORS)]
    assert len(cut.unit) == len(cut.column) == frames * SECTORS
    of_unit = {name: cut.column[[unit == name for unit in cut.unit]] for name in set(cut.unit)}
    assert len(of_unit) == SECTORS
    spans = sorted((columns.min(), columns.max()) for columns in of_unit.values())
    assert all(right[0] - left[1] > 2 * GUARD_COLUMNS for left, right in pairwise(spans))
    assert all(columns.size >= FEWEST_COLUMNS for columns in of_unit.values())
    assert cut.column.size * 44 <= max(RAYS, SECTORS * frames * 44)
    # No column twice in a block.
    assert all(len(set(columns)) == len(columns) for columns in cut.column.tolist())


def test_frames_of_several_drives_keep_their_drives():
    assert blocks(["a", "a", "b"], 44, 372).unit == ("a", "a", "b")


def test_the_fewest_scenes_are_those_with_which_naming_can_pass_its_test():
    def best(scenes):
        find = np.ones(len(split(NAMES[:scenes]).find))
        return 2 * p_value(find)  # the better of two tests

    assert best(FEWEST) <= LEVEL
    assert 2 * p_value(np.ones(FEWEST - 1 - round((FEWEST - 1) / 3))) > LEVEL
