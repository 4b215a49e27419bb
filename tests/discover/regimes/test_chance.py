"""Probabilities of chance are what they say, and few draws must not make sure."""

import numpy as np

from jaxsim.discover.regimes.cells import Cells
from jaxsim.discover.regimes.chance import best_region, divided, existing, flipped
from jaxsim.discover.regimes.questions import Question
from jaxsim.discover.scenes import dealt
from jaxsim.effects.region import Region

SCENES = 11
LATER = np.array([np.arange(SCENES) >= cut for cut in range(3, SCENES - 2)])
WHOLE = np.concatenate([LATER, ~LATER])


def test_scenes_without_order_are_divided_as_often_as_the_probability_says():
    p = np.array([dealt(np.random.default_rng(k).standard_t(3, SCENES), WHOLE)[1] for k in range(200)])
    assert np.mean(p <= 0.05) <= 0.09
    assert np.mean(p <= 0.5) <= 0.58


def test_scenes_that_differ_from_a_moment_on_are_divided_there():
    excess = np.where(np.arange(SCENES) >= 6, 20.0, -15.0) + np.random.default_rng(0).normal(0, 3, SCENES)
    best, p = dealt(excess, WHOLE)
    assert np.array_equal(WHOLE[best], np.arange(SCENES) >= 6)
    assert p < 0.01


def test_a_sector_that_all_scenes_speak_for_goes_before_one_that_few_have_rays_in():
    wide = np.array([15, 18, 19, 6, 11, 16, 7, 19, 10, 13, 22], float)
    narrow = np.where(np.arange(SCENES) < 2, 200.0, 0.0)
    best, p = flipped(np.stack([narrow, wide]), np.ones(2))
    assert best == 1
    assert p < 0.002


def test_a_part_of_a_sector_is_not_clearer_because_its_readings_lie_on_the_tails_of_the_noise():
    """There the likelihood hardly bends: by its curvature alone two of six sectors would be clearer than all."""
    sector = np.arange(12)
    inside = (sector >= 2) & (sector < 8)
    tails = (sector >= 4) & (sector < 6)
    rng = np.random.default_rng(0)
    shape = (SCENES, len(sector))
    slope = np.where(inside, 10.0, -5.0) + rng.normal(0, 1, shape)
    of = Cells(slope, np.broadcast_to(np.where(tails, 0.01, 2.0), shape), np.broadcast_to(5.0 + 5.0 * inside, shape))
    masks = np.stack([np.broadcast_to(part, shape) for part in (tails, inside)])
    question = Question("azimuth", (Region(azimuth_rad=(0.1, 0.2)), Region(azimuth_rad=(0.0, 0.3))), masks)
    assert best_region(question, of, np.arange(SCENES)).k == 1


def test_a_candidate_that_only_some_scenes_gain_by_is_found_among_others():
    rng = np.random.default_rng(1)
    rates = rng.normal(0, 1, (8, SCENES))
    rates[3] = np.where(np.arange(SCENES) >= 6, 12.0, -2.0) + rng.normal(0, 1, SCENES)
    k, strength, p = divided(rates, WHOLE)
    assert np.array_equal(WHOLE[k], np.arange(SCENES) >= 6)
    assert strength[:, k].argmax() == 3
    assert p < 0.02
    assert existing(rates, WHOLE) < 0.02


def test_candidates_of_which_no_scene_says_anything_do_not_stand_before_one_that_some_gain_by():
    """However perfectly thousandths of a nat are divided."""
    rng = np.random.default_rng(2)
    rates = rng.normal(0, 0.003, (40, SCENES))
    rates[7] = np.where(np.arange(SCENES) >= 4, 0.002, -0.002)
    rates[3] = np.where(np.arange(SCENES) >= 7, 40.0, -3.0) + rng.normal(0, 5, SCENES)
    k, strength, p = divided(rates, WHOLE)
    assert strength[:, k].argmax() == 3
    assert np.array_equal(WHOLE[k], np.arange(SCENES) >= 7)
    assert p < 0.01
    assert existing(rates, WHOLE) < 0.01
    assert np.delete(strength, 3, 0).max() < 0.2


def test_candidates_of_nothing_do_not_exist():
    p = [existing(np.random.default_rng(k).normal(0, 1, (6, SCENES)), WHOLE) for k in range(20)]
    assert np.mean(np.array(p) <= 0.1) <= 0.3
