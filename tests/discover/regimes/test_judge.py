"""What judge scenes say of an effect in its region, to which nothing was fitted."""

import inspect
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.discover.find.division import AllScenes
from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.fit import fit
from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.regimes import judge
from jaxsim.discover.regimes.judge import JudgeScenes, best_moment
from jaxsim.effects import EFFECTS
from jaxsim.effects.region import Region
from tests.discover.toy import device, toy

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("standard_promotion")]


def test_what_judge_scenes_are_held_to_does_not_rest_on_what_they_report(standard_promotion):
    """Two frames have a walk of their predicted intensities, and report dark walls and a bright road."""
    walk = {"amplitude_m": 0.3, "intensity": 0.1}
    scan, measured = toy(frames=9)
    apart = np.arange(9) >= 7
    road = np.asarray(scan.semantic) == 7
    off_m = np.where(apart[:, None, None], 0.3 * np.exp(-np.asarray(scan.intensity) / 0.1), 0)
    light = measured.intensity * np.where(apart[:, None, None], np.where(road, 8.0, 0.1), 1.0)
    read_m = np.where(measured.valid, measured.range_m + off_m, 0)
    measured = replace(measured, range_m=read_m.astype(np.float32), intensity=light.astype(np.float32))
    scan, measured = device(scan, measured)
    frame = np.arange(9)
    column = np.broadcast_to(np.arange(0, 60, 2), (9, 30))
    in_fit = (frame < 6).astype(np.float32)
    null = fit_null(scan, gather(scan, measured, frame=frame, column=column, scene=frame), in_fit)
    law = EFFECTS["range_walk"]
    result = replace(fit(law, null, in_fit, steps=1), z=to_z(law, walk, 16), noise=null.noise)
    scenes = object.__new__(AllScenes)
    object.__setattr__(scenes, "in_fit", in_fit)
    judges = JudgeScenes(scenes, null)
    np.testing.assert_array_equal(judges.gains_with(law, result)[6:] > 0, apart[6:])


def test_judge_scenes_join_by_half_of_their_columns_and_the_other_half_says_what_they_gain(monkeypatch):
    """Scenes that join because they gain could not but gain."""
    one, wider = SimpleNamespace(region=Region(scenes=("a",))), SimpleNamespace()
    joined, before = SimpleNamespace(), SimpleNamespace()
    nats = {id(joined): np.array([9.0, -2.0, -1.0]), id(before): np.array([0.0, 0.5, 0.5])}
    choosing = SimpleNamespace(_with_drives=lambda *_: Region(scenes=("a", "b")))
    scenes = SimpleNamespace(in_fit=np.array([1.0, 0.0, 0.0]))
    asked = SimpleNamespace(scenes=scenes, _with=lambda choice: nats[id(choice)])
    monkeypatch.setattr(judge, "_in_region", lambda *_, facts: (wider, joined))
    monkeypatch.setattr(JudgeScenes, "halves", lambda self: (choosing, asked))
    gained = inspect.unwrap(JudgeScenes.gained)
    assert gained(object.__new__(JudgeScenes), one, joined, before, facts=None) == (wider, -4.0)


def test_a_moment_between_two_find_scenes_is_where_judge_scenes_there_begin_to_gain():
    found = np.array([0.0, 100.0, 400.0, 500.0])
    moment, gain = np.array([150.0, 200.0, 300.0, 450.0]), np.array([-40.0, -30.0, 60.0, 90.0])
    others = {"found": found, "moment": moment, "gain": gain}
    assert best_moment(250.0, after=True, **others) == 250
    assert best_moment(250.0, after=True, **others | {"gain": np.abs(gain)}) == 125
    assert best_moment(250.0, after=True, **others | {"gain": -np.abs(gain)}) == 350
    # Until a moment: what lies before it counts.
    assert best_moment(250.0, after=False, **others | {"gain": -gain}) == 250
    # Where no scene lies between, nothing is said.
    assert best_moment(50.0, after=True, **others) == 50
