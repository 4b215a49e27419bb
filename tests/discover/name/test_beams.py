"""Numbers of single beams against a smooth change along the rows."""

import numpy as np
import pytest

from jaxsim.discover.name.beams import REACH, by_beam, smooth
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import accepted
from jaxsim.effects import EFFECTS


def test_a_line_is_smooth_and_stays_what_it_is():
    line = 0.3 - 0.02 * np.arange(32)
    np.testing.assert_allclose(smooth(line), line, atol=1e-12)


def test_a_number_becomes_the_least_squares_line_of_its_neighbours():
    numbers = np.random.default_rng(0).normal(size=20)
    at = 9
    x = np.arange(at - REACH, at + REACH + 1)
    slope, level = np.polyfit(x, numbers[x], 1)
    assert smooth(numbers)[at] == pytest.approx(slope * at + level)


def test_numbers_of_a_beam_each_are_smoothed_to_less_than_half_their_variance():
    numbers = np.random.default_rng(1).normal(size=4000)
    assert np.var(smooth(numbers)) < 0.5 * np.var(numbers)


def test_one_beam_or_two_are_left_as_they_are():
    np.testing.assert_allclose(smooth(np.array([0.4])), [0.4])
    np.testing.assert_allclose(smooth(np.array([0.4, -0.1])), [0.4, -0.1], atol=1e-12)


def test_the_catalogue_has_four_effects_of_single_beams():
    found = {name for name, effect in EFFECTS.items() if by_beam(effect)}
    assert found == {"beam_gain", "beam_range_bias", "beam_elevation_error", "focal_compensation"}


@pytest.mark.parametrize(("rough", "passes"), [(5.0, True), (0.5, False), (-3.0, False)])
def test_gains_of_beams_are_named_only_for_what_a_smooth_change_does_not_explain(rough, passes):
    gain = np.tile([8.0, 0.0, 0.0], (11, 1))
    candidate = Candidate(EFFECTS["beam_gain"], gain, (), gain.sum(-1) / 4, np.full(11, rough))
    assert accepted(candidate) == passes
