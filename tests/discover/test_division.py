"""Blocks know their scene, scenes are divided once, and find scenes alone are fitted."""

import numpy as np
import pytest

from jaxsim.discover.division import NOTHING_YET, AllScenes, Division, NullModel, same_surfaces
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.read import Comparison
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.scan import scan_of
from tests.discover import noisy_street, rooms
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
    np.testing.assert_array_equal(every.fitted, first)


def test_known_effects_are_in_place(division):
    known = SensorModel((("random_dropout", {"probability": 0.25}),))
    bare, _ = division.evidence(division.parts.find)
    placed, _ = division.evidence(division.parts.find, known)
    hit = np.asarray(bare.rays.hit)
    lost = np.asarray(placed.rays.log_keep - bare.rays.log_keep)[hit]
    np.testing.assert_allclose(lost, np.log(0.75), rtol=1e-5)


def test_what_moved_is_seen_by_neither_side_and_a_lost_ray_stays_lost():
    streets = rooms.rooms(2)
    scan = scan_of(rooms.GRID, [rooms.seen(room) for room in streets])
    measured = rooms.measured_of([rooms.seen(room) for room in streets])
    moving = np.zeros(scan.hit.shape, bool)
    moving[:, 4:12, 20:30] = True
    measured.range_m[moving] -= 2
    measured.valid[0, 15, 100] = False
    one, other = same_surfaces(scan, measured)
    assert not one.hit[moving].any()
    assert not other.valid[moving].any()
    assert one.hit[0, 15, 100]
    assert not other.valid[0, 15, 100]
    # A ray in a corner of the image has no two neighbours.
    assert (~one.hit[~moving]).sum() == 2 * 4


def test_the_share_of_lost_rays_is_that_of_all():
    scan = scan_of(rooms.GRID, [rooms.seen(room) for room in rooms.rooms(6)])
    measured = rooms.measured_of([rooms.seen(room) for room in rooms.rooms(6)])
    lost = np.random.default_rng(0).random(scan.hit.shape) < 0.1
    measured.range_m[:, 4:12, 20:60] -= 2
    measured.valid[lost] = False
    one, other = same_surfaces(scan, measured)
    kept = np.asarray(one.hit)
    share = 1 - np.asarray(other.valid)[kept].mean()
    assert abs(share - 0.1) < 3 * np.sqrt(0.09 / kept.sum())


@pytest.mark.parametrize(("loss", "told"), [(0.005, True), (0.08, False)])
def test_of_what_a_simulator_that_loses_many_rays_reports_nothing_returns_tell_nothing(loss, told):
    of = noisy_street.comparison({"loss": loss}, {"range_m": 0.01}, FRAMES)
    division = Division.of(of)
    assert (division.simulator.noise.loss > 0.02) is not told
    # Rays at the border of the street, which no neighbours put back.
    lost = ~np.asarray(division.scan.hit)
    assert (np.asarray(of.measured.valid) & lost).any()
    assert (np.asarray(division.measured.valid) & lost).any() == told
