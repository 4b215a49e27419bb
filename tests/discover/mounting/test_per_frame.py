"""Frames that each stand a little elsewhere, as a car that rides on its springs does."""

from copy import copy

import numpy as np
import pytest

from jaxsim.discover.find.division import NOTHING_YET
from jaxsim.discover.model.evidence import POSE_SD
from jaxsim.discover.mounting.per_frame import is_unsteady, scatter_of, steadied
from jaxsim.discover.rules import RULES
from jaxsim.discover.stages.place import place
from jaxsim.discover.workflow import disagreements
from tests.discover.rooms import NAMES, comparison, off_m

pytestmark = pytest.mark.usefixtures("standard_promotion")


def heights(sd_m: float, *, mean_m: float = 0.0) -> np.ndarray:
    """Poses of frames that ride low, most of them, or high: their distances from the median have a median of 0."""
    poses = np.zeros((len(NAMES), 6))
    poses[:, 2] = mean_m - sd_m
    poses[::3, 2] = mean_m + sd_m
    return poses


def test_a_car_that_rides_on_its_springs_is_told_and_each_frame_is_brought_to_its_place():
    one = comparison(heights(0.08))
    assert is_unsteady(one)
    steady = steadied(one)
    assert off_m(steady) < 0.5 * off_m(one)
    assert off_m(steady) < 0.02
    assert steady.own_places
    assert "stand each a little elsewhere" in steady.notes[-1]


def test_frames_that_scatter_as_poses_usually_do_stay_where_they_are():
    assert not is_unsteady(comparison(heights(0.02)))
    # What all frames share is a mounting.
    assert not is_unsteady(comparison(np.full((len(NAMES), 6), [0, 0, 0.2, 0, 0, 0])))


def test_one_frame_that_was_registered_to_another_street_decides_nothing():
    one = comparison(np.zeros(6))
    registration, frames = copy(one.registration), one.registration.frames.copy()
    frames[4, 0] = 2.0
    object.__setattr__(registration, "frames", frames)
    assert (scatter_of(registration) < RULES.unsteady_sd * POSE_SD).all()


def test_a_mounting_that_is_surely_off_stays_to_be_named():
    one = steadied(comparison(heights(0.06, mean_m=0.4)))
    assert "extrinsic_translation" in one.registration.sure
    # What the mounting is off by is still between the sides.
    assert off_m(one) > 0.05


@pytest.mark.long
def test_place_brings_unsteady_frames_before_anything_else_is_asked():
    lines: list[str] = []
    one = comparison(heights(0.08))
    placed = place(one, [], NOTHING_YET, log=lines.append)
    assert placed.comparison.own_places
    assert any("every simulated one is brought" in line for line in lines)
    # The list of disagreements alone is made from there, too.
    assert disagreements(one) == placed.found.where
