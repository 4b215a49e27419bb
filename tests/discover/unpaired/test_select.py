"""Which candidate is accepted, and who is its look-alike."""

import numpy as np

from jaxsim.discover.unpaired.select import _alike, _folds
from tests.discover.unpaired.made import candidate


def test_both_tests_must_be_passed():
    assert candidate("beam_gain", 3.0).accepted
    assert not candidate("beam_gain", 3.0, chance=0.02).accepted
    assert not candidate("beam_gain", -0.5).accepted


def test_a_look_alike_need_not_be_accepted_but_gains_about_as_much():
    best = candidate("beam_gain", 3.0)
    assert _alike(candidate("range_falloff", 3.0, chance=0.04), best)
    assert not _alike(candidate("range_falloff", 3.0, chance=0.06), best)
    assert not _alike(candidate("range_falloff", 1.0), best)
    assert not _alike(candidate("range_falloff", 2.5), best)  # every scene says less


def test_scenes_of_either_side_are_dealt_to_the_folds_in_turn():
    measured = np.array([True, True, False, True, False, True, True])
    np.testing.assert_array_equal(_folds(measured), [0, 1, 0, 2, 1, 3, 0])
