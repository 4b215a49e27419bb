import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxsim.data.select import select


def test_ranges_and_single_numbers_keep_their_order():
    assert select("0-3,7", 8) == [0, 1, 2, 3, 7]
    assert select(" 5 , 1 - 2", 6) == [5, 1, 2]
    assert select("0-9:4,3", 10) == [0, 4, 8, 3]


@given(st.sets(st.integers(0, 50), min_size=1))
def test_any_list_of_numbers_reads_back(numbers):
    chosen = sorted(numbers)
    assert select(",".join(map(str, chosen)), 51) == chosen


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
        select(text, 6)
