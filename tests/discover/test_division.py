"""Blocks know their scene, and scenes are divided once."""

import numpy as np
import pytest

from jaxsim.discover.division import Division
from jaxsim.discover.read import Comparison
from jaxsim.effects.chain import SensorModel
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


def test_all_evidence_has_the_find_scenes_first(division):
    ev, scene = division.all_evidence()
    find, _ = division.evidence(division.parts.find)
    times = np.asarray(ev.rays.time_s)[:, 0, 0]
    first = times[scene < len(division.parts.find)]
    np.testing.assert_array_equal(first, np.asarray(find.rays.time_s)[:, 0, 0])


def test_known_effects_are_in_place(division):
    known = SensorModel((("random_dropout", {"probability": 0.25}),))
    bare, _ = division.evidence(division.parts.find)
    placed, _ = division.evidence(division.parts.find, known)
    hit = np.asarray(bare.rays.hit)
    lost = np.asarray(placed.rays.log_keep - bare.rays.log_keep)[hit]
    np.testing.assert_allclose(lost, np.log(0.75), rtol=1e-5)
