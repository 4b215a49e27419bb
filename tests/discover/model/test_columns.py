"""Which columns of which frames are looked at."""

from itertools import pairwise

import pytest

from jaxsim.discover.model.columns import FEWEST_COLUMNS, GUARD_COLUMNS, RAYS, SECTORS, blocks


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
