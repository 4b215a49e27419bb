from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxsim.data.select import frame_number, select, select_or_all


def test_ranges_and_single_numbers_keep_their_order():
    assert select("0-3,7", range(8)) == [0, 1, 2, 3, 7]
    assert select(" 5 , 1 - 2", range(6)) == [5, 1, 2]
    assert select("0-9:4,3", range(10)) == [0, 4, 8, 3]


def test_a_frame_is_given_by_a_whole_number_within_the_ends():
    assert [frame_number(index, "kitti", 6) for index in (0, 5, np.int64(3), -1, -6)] == [0, 5, 3, 5, 0]
    for index, told in ((1.0, "1.0"), ("3", "'3'"), (slice(0, 2), r"slice\(0, 2, None\)")):
        with pytest.raises(TypeError, match=f"kitti: a frame is given by its number, 0 to 5, not by {told}; for"):
            frame_number(index, "kitti", 6)
    for index in (6, -7):
        with pytest.raises(IndexError, match=f"kitti: there is no frame {index}; the data set has 0 to 5"):
            frame_number(index, "kitti", 6)


@given(st.sets(st.integers(0, 50), min_size=1))
def test_any_list_of_numbers_reads_back(numbers):
    chosen = sorted(numbers)
    assert select(",".join(map(str, chosen)), range(51)) == chosen


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no frame number"),
        ("1,,2", "is no frame number"),
        ("a", "is no frame number"),
        ("-1", "is no frame number"),
        ("3-1", "runs backwards; write 1-3"),
        ("4-6", "no frame 6; the data set has 0-5"),
        ("1,0-2", "frame 1 is named more than once"),
    ],
)
def test_bad_text_is_explained(text, message):
    with pytest.raises(ValueError, match=message):
        select(text, range(6))


class Parted(list):
    splits: ClassVar = {"training": [0, 1, 2, 3, 6], "evaluation": [4, 5], "empty": []}


def test_a_named_part_is_taken_whole_or_thinned_and_mixes_with_numbers():
    frames = Parted(range(7))
    assert select("evaluation", frames) == [4, 5]
    assert select("training:2", frames) == [0, 2, 6]
    assert select("evaluation, 6", frames) == [4, 5, 6]


def test_all_but_is_what_is_left():
    frames = Parted(range(7))
    assert select("all but evaluation", frames) == [0, 1, 2, 3, 6]
    assert select("all but evaluation,0-1", frames) == [2, 3, 6]
    with pytest.raises(ValueError, match="none of the data set's 7; name fewer"):
        select("all but 0-6", frames)


def test_names_may_begin_with_a_date():
    class Dated(list):
        splits: ClassVar = {"2011_09_26_drive_0001": [1, 2]}

    assert select("2011_09_26_drive_0001, 0", Dated(range(3))) == [1, 2, 0]
    assert select("2011_09_26_drive_0001:2", Dated(range(3))) == [1]


def test_a_list_may_have_any_name_that_is_no_number_and_has_no_comma():
    class Listed(list):
        splits: ClassVar = {"my-list": [1, 2], "5 % of it": [0, 2]}

    assert select("my-list, 0", Listed(range(3))) == [1, 2, 0]
    assert select("5 % of it : 2", Listed(range(3))) == [0]
    assert select("all but my-list", Listed(range(3))) == [0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "test",
            "'test' is no frame number, and the data set has no part of that name; it has training, evaluation, empty",
        ),
        ("empty", "no frame of empty is here"),
        ("evaluation,5", "frame 5 is named more than once"),
    ],
)
def test_a_part_that_is_not_there_is_explained(text, message):
    with pytest.raises(ValueError, match=message):
        select(text, Parted(range(7)))


@pytest.mark.parametrize(("text", "positions"), [("1", [1]), ("2-3", [2, 3]), ("", [0, 1, 2, 3, 4])])
def test_no_frames_named_are_all_of_them(text, positions):
    assert select_or_all(text, range(5)) == positions
