"""A training pair as a record."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data.records import Entry, PreparedPairs, check_example, pair_settings


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid/azimuth_rad": np.float32(0)}, r"azimuth_rad is float32 \(\), not float32 \(c\)"),
        ({"edges": np.zeros((4, 8))}, r"edges is float64 \(4, 8\), not bool"),
        ({"edges": np.zeros((4, 9), bool)}, r"edges is bool \(4, 9\)"),
        ({"position": "x"}, "position is"),
    ],
)
def test_a_kept_pair_of_other_types_and_shapes_is_no_pair(change, message):
    right = {"edges": np.zeros((4, 8), bool), "grid/azimuth_rad": np.zeros(8, "f4"), "name": "a", "position": 3}
    check_example(right)
    with pytest.raises(ValueError, match=message):
        check_example({"row": np.zeros((4, 8), "f4"), **right, **change})


def test_settings_of_how_a_network_sees_pairs_are_none_of_theirs():
    plain, asked = DataConfig(), PrepareConfig(inputs=("rgb", "edges"))
    seen = replace(asked, inputs=("semantic",), classes=(7,), network_size=(32, 64), max_range_m=80)
    assert pair_settings(plain, seen) == pair_settings(plain, asked)
    # As sets and folders of pairs have it that are kept.
    kept = {"inputs": ["semantic"], "classes": [], "network_size": [0, 0], "max_range_m": 0.0}
    assert pair_settings(plain, asked)["prepare"].items() >= kept.items()
    assert pair_settings(plain, replace(asked, inputs=("rgb",)))["prepare"]["inputs"] == []
    assert pair_settings(plain, replace(asked, columns=64)) != pair_settings(plain, asked)


class Read(NamedTuple):
    pair: str


def test_pairs_are_parted_and_put_together_without_being_read():
    def pairs(letters: str) -> PreparedPairs:
        return PreparedPairs([Entry(x, "a drive", (4, 8), x) for x in letters], lambda i: Read(letters[i].upper()))

    both = pairs("abc") + pairs("de")
    assert (both.names, list(both), both[-1]) == ([*"abcde"], [*"ABCDE"], "E")
    assert (list(both[1:4]), both[1:4].names, list(both[2:][1:])) == ([*"BCD"], [*"bcd"], [*"DE"])
    assert not both[:0]
