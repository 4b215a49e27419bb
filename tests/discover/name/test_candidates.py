"""What counts as agreement between scenes, and what beams must gain over a smooth change along the rows."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.name import candidates
from jaxsim.discover.name.candidates import by_beam, rank_effects, smooth
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from tests.discover.name.made import candidate, fitted, problem

STEADY = np.array([4.0, 5, 3, 6, 4, 5, 2, 4, 3, 5, 6])


def test_two_scenes_cannot_decide():
    gain = np.array([900.0, 800.0, 3.0, -1.0, -2.0, -1.0, 1.0, -400.0, 2.0, -1.0, -2.0])
    assert not candidate("beam_gain", gain, slope=gain).accepted()


def test_scenes_that_agree_are_believed_and_scenes_that_do_not_are_not():
    assert candidate("beam_gain", STEADY).accepted()
    assert candidate("beam_gain", STEADY).chance == pytest.approx(2 / 2048)
    split = STEADY * np.array([1, -1, 1, 1, -1, 1, 1, -1, 1, 1, -1])
    assert not candidate("beam_gain", split).accepted()
    assert not candidate("beam_gain", STEADY / 10).accepted()  # agreed, but next to nothing


def test_the_direction_of_a_fit_can_be_agreed_where_its_length_is_not():
    gain = np.array([30.0, 25, 12, -19, 9, 31, -12, 28, 11, 3, 4])
    slope = np.array([9.0, 8, 4, 1, 3, 9, 0.5, 8, 4, 4, 5])
    assert not candidate("beam_gain", gain).accepted()
    assert candidate("beam_gain", gain, slope=slope).accepted()


def test_scenes_that_agree_on_a_direction_and_may_not_gain_at_all_are_not_believed():
    """Errors of one simulator's surfaces push eight scenes the same way, and a few lose what the others gain."""
    gain = np.array([-21.9, -17.5, 12.2, 54.1, 44.4, 8.8, 10.9, 24.1])
    gamma = candidate("gamma_response", gain, slope=np.full(8, 5.0), scenes=8)
    assert gamma.chance < 0.02
    assert not gamma.accepted()
    assert candidate("gamma_response", np.abs(gain), slope=np.full(8, 5.0), scenes=8).accepted()


def test_rare_events_need_three_scenes_and_no_others_against_them():
    rare = np.array([210.0, 0, 0, 180, 0, -0.4, 0, 190, -0.3, 0, -0.2])
    assert candidate("packet_loss", rare).accepted()
    assert not candidate("packet_loss", np.where(rare > 200, 0, rare)).accepted()
    assert not candidate("packet_loss", rare - 40).accepted()


def test_what_gains_less_than_a_raised_bar_is_not_accepted():
    strong = candidate("gamma_response", STEADY)
    assert strong.total == pytest.approx(45)  # none more than the third largest
    assert strong.accepted(44.0)
    assert not strong.accepted(46.0)


def test_a_line_is_smooth_and_stays_what_it_is():
    line = 0.3 - 0.02 * np.arange(32)
    np.testing.assert_allclose(smooth(line), line, atol=1e-12)


def test_a_number_becomes_the_least_squares_line_of_its_neighbours():
    numbers = np.random.default_rng(0).normal(size=20)
    at = 9
    x = np.arange(at - RULES.beam_rows, at + RULES.beam_rows + 1)
    slope, level = np.polyfit(x, numbers[x], 1)
    assert smooth(numbers)[at] == pytest.approx(slope * at + level)


def test_numbers_of_a_beam_each_are_smoothed_to_less_than_half_their_variance():
    numbers = np.random.default_rng(1).normal(size=4000)
    assert np.var(smooth(numbers)) < 0.5 * np.var(numbers)


def test_one_beam_or_two_are_left_as_they_are():
    np.testing.assert_allclose(smooth(np.array([0.4])), [0.4])
    np.testing.assert_allclose(smooth(np.array([0.4, -0.1])), [0.4, -0.1], atol=1e-12)


def test_the_catalogue_has_six_effects_of_single_beams():
    beams = {name for name, effect in EFFECTS.items() if by_beam(effect)}
    pointing = {"beam_elevation_error", "beam_azimuth_error"}
    assert beams == {"beam_gain", "beam_dropout", "beam_range_bias", "focal_compensation", *pointing}


@pytest.mark.parametrize(("rough", "passes"), [(5.0, True), (0.5, False), (-3.0, False)])
def test_gains_of_beams_are_named_only_for_what_a_smooth_change_does_not_explain(rough, passes):
    assert replace(candidate("beam_gain", 8.0), over_smooth=np.full(11, rough)).accepted() == passes


@pytest.mark.parametrize(("slope", "passes"), [(None, False), (1.0, True), (-1.0, False)])
def test_scenes_may_agree_that_single_beams_are_off_and_not_by_how_much(slope, passes):
    rough = np.array([9.0, -5, 9, -5, 9, -5, 9, -5, 9, 9, 9])
    begun = None if slope is None else np.full(11, slope)
    assert replace(candidate("beam_gain", 8.0), over_smooth=rough, over_smooth_slope=begun).accepted() == passes


@pytest.mark.parametrize(
    ("each", "bar", "fits"),
    [(0.5, 10.0, 1), (1.0, 10.0, 3), (0.5, -np.inf, 3)],  # four scenes are fitted: they must gain a quarter of it
)
def test_what_cannot_reach_the_bar_is_not_fitted_on_the_other_folds(each, bar, fits, monkeypatch):
    score = np.zeros((6, 3))
    score[:, 2] = each
    monkeypatch.setattr(candidates, "rounded", lambda ev: {})
    monkeypatch.setattr(candidates, "starts_of", lambda problem: {})
    monkeypatch.setattr(candidates, "best_starts", lambda *_, parts: [{}] * len(parts))
    monkeypatch.setattr(candidates, "partway", lambda *_, **__: score)
    monkeypatch.setattr(candidates, "fit", lambda *_, **__: replace(fitted(), score=score))
    monkeypatch.setattr(candidates, "replace", lambda problem, **_: problem)
    null = [replace(fitted(), score=np.zeros((6, 3)))] * 3
    ev = SimpleNamespace(scene=np.arange(6), scenes=6)
    [one] = rank_effects(problem(ev=ev), [EFFECTS["random_dropout"]], null_fits=null, bar=bar)
    assert len(one.fits) == fits
    assert not one.accepted(10.0)
