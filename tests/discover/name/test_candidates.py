"""What counts as agreement between scenes, and what beams must gain over a smooth change along the rows."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.null import fit_null
from jaxsim.discover.name.candidates import by_beam, smooth, starts_of
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from tests.discover.name.made import candidate
from tests.discover.toy import toy

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
    gain = np.array([30.0, 25, 12, -29, 9, 31, -22, 28, 11, 3, 4])
    slope = np.array([9.0, 8, 4, 1, 3, 9, 0.5, 8, 4, 4, 5])
    assert not candidate("beam_gain", gain).accepted()
    assert candidate("beam_gain", gain, slope=slope).accepted()


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


def test_the_catalogue_has_four_effects_of_single_beams():
    beams = {name for name, effect in EFFECTS.items() if by_beam(effect)}
    assert beams == {"beam_gain", "beam_range_bias", "beam_elevation_error", "focal_compensation"}


@pytest.mark.parametrize(("rough", "passes"), [(5.0, True), (0.5, False), (-3.0, False)])
def test_gains_of_beams_are_named_only_for_what_a_smooth_change_does_not_explain(rough, passes):
    assert replace(candidate("beam_gain", 8.0), over_smooth=np.full(11, rough)).accepted() == passes


@pytest.fixture(scope="module")
def problem(evidence, scan):
    problem, _ = fit_null(scan, evidence, np.ones(6, np.float32))
    return problem


@pytest.fixture(scope="module")
def scan():
    return toy()[0]


def changed(problem, **fields):
    return replace(problem, ev=problem.ev.replace(**{k: jnp.asarray(v) for k, v in fields.items()}))


def test_nothing_to_read(problem):
    assert starts_of(problem) == {}


def test_a_ceiling_is_where_readings_pile_up(problem):
    ev = problem.ev
    top = float(np.quantile(np.asarray(ev.log_intensity)[np.asarray(ev.returned)], 0.95))
    found = starts_of(changed(problem, log_intensity=np.minimum(ev.log_intensity, top)))
    assert found["saturation"][0]["ceiling"] == pytest.approx(np.exp(top), rel=1e-4)


def test_a_gate_is_the_nearest_return(problem):
    ev = problem.ev
    near = np.asarray(ev.rays.range_m) < 7.0
    assert (near & np.asarray(ev.rays.hit)).sum() >= 5
    found = starts_of(changed(problem, returned=np.asarray(ev.returned) & ~near))
    assert 6.5 <= found["range_gate"][0]["minimum_m"] < 8.0
    assert all("maximum_m" not in start for start in found["range_gate"])


def test_a_hidden_sector_is_where_all_frames_lose(problem):
    ev = problem.ev
    azimuth = np.asarray(ev.rays.azimuth_rad)
    found = starts_of(changed(problem, returned=np.asarray(ev.returned) & (np.abs(azimuth - 0.8) > 0.3)))
    widths = [start["width_rad"] for start in found["sector_occlusion"]]
    assert found["sector_occlusion"][0]["azimuth_rad"] == pytest.approx(0.8, abs=0.15)
    assert min(widths) < 0.6 < max(widths)


@pytest.mark.parametrize("after", [5, 14])
def test_a_hidden_sector_behind_the_car_is_one(problem, after):
    """Two of the fifteen columns: 5 and 6, or on both sides of the seam 14 and 0."""
    step = 2 * np.pi / 15
    middle = np.pi - step / 8 - (after + 0.5) * step
    off = np.angle(np.exp(1j * (np.asarray(problem.ev.rays.azimuth_rad) - middle)))
    ended = starts_of(changed(problem, returned=np.asarray(problem.ev.returned) & (np.abs(off) > 0.3)))
    start = ended["sector_occlusion"][1]
    assert -np.pi <= start["azimuth_rad"] <= np.pi
    assert abs(np.angle(np.exp(1j * (start["azimuth_rad"] - middle)))) < 0.03
    assert start["width_rad"] == pytest.approx(2 * step, abs=0.05)
