"""Sums of scales against loops over cells: phases are those of the columns that are there."""

import numpy as np
import pytest

from jaxsim.discover.repeats.scales import scales
from tests.discover.repeats.made import COLUMNS, ROWS, maps

SCALES = {(one.name, one.along): one for one in scales(ROWS, COLUMNS, bins=32)}


def patterns_of(key):
    pattern = SCALES[key].pattern
    assert pattern
    return pattern


SINGLE = [key for key, one in SCALES.items() if one.pattern]


@pytest.mark.parametrize("key", SINGLE, ids="-".join)
def test_a_sum_is_that_of_its_pattern(key):
    total = maps(0).total[:2]
    scale = SCALES[key]
    sums = scale.sums(total)
    for k in {0, sums.shape[1] // 2, sums.shape[1] - 1}:
        pattern = patterns_of(key)(k, 1.0)
        shown = sum(pattern[r, c] * total[:, r, c] for r in range(ROWS) for c in range(COLUMNS))
        np.testing.assert_allclose(np.real(sums[:, k]), shown, atol=1e-8)


@pytest.mark.parametrize("key", SINGLE, ids="-".join)
def test_information_is_the_mean_square_of_a_pattern(key):
    weight = np.ones((3, ROWS, COLUMNS))
    scale = SCALES[key]
    squares = (patterns_of(key)(0, 1.0) ** 2).sum() * 3
    # A wave's sum has a real and an imaginary part.
    assert scale.information(weight)[0] == pytest.approx(squares * (2 if key[0] == "wave" else 1))


def test_a_wave_has_the_phase_of_its_sum():
    scale = SCALES["wave", "column"]
    pattern = patterns_of(("wave", "column"))
    made = pattern(9, np.exp(0.7j))[None]
    assert np.angle(scale.sums(made)[0, 9]) == pytest.approx(0.7, abs=0.1)
    assert pattern(9, scale.sums(made)[0, 9]) == pytest.approx(made[0], abs=0.1)
