"""Blocks know their scene, scenes are divided once, and find scenes alone are fitted."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.find.division import NOTHING_YET, AllScenes, Division, NullModel
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.read import Comparison
from jaxsim.effects.chain import SensorModel
from tests.discover import noisy_street
from tests.discover.toy import toy

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = 12


@pytest.fixture(scope="module")
def division(standard_promotion):
    scan, measured = toy(FRAMES)
    names = tuple(f"frame {k}" for k in range(FRAMES))
    return Division.of(Comparison(scan, measured, names, tuple(f"drive {k}" for k in range(FRAMES))))


def test_find_and_judge_scenes_share_no_frame(division):
    frames = []
    for names in (division.parts.find, division.parts.judge):
        ev, scene = division.evidence(names)
        assert sorted(scene) == list(range(len(names)))
        frames.append(set(np.unique(np.asarray(ev.rays.time_s)).tolist()))
    assert not frames[0] & frames[1]
    assert len(frames[0] | frames[1]) == FRAMES


def test_all_scenes_have_the_find_scenes_first_and_these_alone_are_fitted(division):
    every = AllScenes.of(NullModel(division, NOTHING_YET, problem=object.__new__(Problem)))
    find, scene = division.evidence(division.parts.find)
    times = np.asarray(every.ev.rays.time_s)[:, 0, 0]
    first = every.scene < len(division.parts.find)
    np.testing.assert_array_equal(times[first], np.asarray(find.rays.time_s)[:, 0, 0])
    np.testing.assert_array_equal(every.scene[first], scene)
    np.testing.assert_array_equal(every.in_fit, first)


def test_known_effects_are_in_place(division):
    known = SensorModel((("random_dropout", {"probability": 0.25}),))
    bare, _ = division.evidence(division.parts.find)
    placed, _ = division.evidence(division.parts.find, known)
    hit = np.asarray(bare.rays.hit)
    lost = np.asarray(placed.rays.log_keep - bare.rays.log_keep)[hit]
    np.testing.assert_allclose(lost, np.log(0.75), rtol=1e-5)


@pytest.mark.parametrize(("loss", "told"), [(0.005, True), (0.08, False)])
def test_of_what_a_simulator_that_loses_many_rays_reports_nothing_returns_tell_nothing(loss, told):
    of = noisy_street.comparison({"loss": loss}, {"range_m": 0.01}, FRAMES)
    division = Division.of(of)
    assert (division.simulator.noise.loss > 0.02) is not told
    # Rays at the border of the street, which no neighbours put back.
    lost = ~np.asarray(division.scan.hit)
    assert (np.asarray(of.measured.valid) & lost).any()
    assert (np.asarray(division.measured.valid) & lost).any() == told


def with_box(columns):
    """A street in which the simulator lacks a box of so many columns, and where it is."""
    of = noisy_street.comparison({}, {"range_m": 0.01}, FRAMES)
    box = np.zeros(of.scan.hit.shape, bool)
    box[:, 10:16, 100 : 100 + columns] = True
    nearer = np.where(box, 3.0, of.measured.range_m).astype(np.float32)
    return replace(of, measured=replace(of.measured, range_m=nearer)), box


@pytest.mark.parametrize("columns", [0, 40])
def test_a_surface_that_the_simulator_lacks_is_left_out_and_said(columns):
    of, box = with_box(columns)
    division = Division.of(of)
    assert bool(division.left_out) is (columns > 0)
    valid = np.asarray(division.measured.valid)
    assert not valid[box].any()
    np.testing.assert_array_equal(valid[~box], of.measured.valid[~box])


def test_further_frames_lack_what_was_left_out_of_those_before_and_nothing_else():
    """However small a box is in them, or large: all frames are compared by one rule."""
    none, small, large = (Division.of(with_box(columns)[0]) for columns in (0, 2, 40))
    assert not small.left_out
    assert large.left_out
    for columns, before, left_out in ((2, large, True), (40, none, False)):
        of, box = with_box(columns)
        division = Division.of(of, chosen=before.blocks, like=before)
        assert np.asarray(division.measured.valid)[box].any() is not left_out
        assert division.parts == before.parts
