"""Intervals hold the truth, and no more than they must."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.evidence import gather
from jaxsim.discover.fit import fit
from jaxsim.discover.intervals import WIDER, intervals
from jaxsim.discover.nuisance import MOST
from jaxsim.discover.null import fit_null
from jaxsim.effects import EFFECTS
from tests.discover.conftest import device, toy

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = np.arange(8)


def fitted(effect: str, scan, measured):
    scan, measured = device(scan, measured)
    ev = gather(scan, measured, FRAMES, np.broadcast_to(np.arange(0, 60, 2), (8, 30)), FRAMES)
    everyone = np.ones(8, np.float32)
    problem, _ = fit_null(scan, ev, everyone)
    return problem, fit(EFFECTS[effect], problem, everyone, steps=80)


def test_beams_gains_lie_in_their_intervals():
    spread = 0.2
    scan, measured = toy(frames=8, gain=spread, seed=4)
    truth = np.random.default_rng(4).normal(0, spread, 16)  # toy draws them first
    problem, found = fitted("beam_gain", scan, measured)
    each = intervals(EFFECTS["beam_gain"], problem, found)["gain"]
    middle = np.mean([one.value for one in each]) - truth.mean()
    inside = [one.low <= true + middle <= one.high for one, true in zip(each, truth, strict=True)]
    assert np.mean(inside) >= 0.8
    assert np.median([one.high - one.low for one in each]) < 0.2 * WIDER


def test_a_rate_at_its_bound_does_not_blow_an_interval_up():
    share = 0.06
    scan, measured = toy(frames=8, seed=7)
    lost = np.random.default_rng(8).random(np.shape(measured.valid)) < share
    problem, found = fitted("random_dropout", scan, replace(measured, valid=measured.valid & ~lost))
    assert float(found.noise.drop) == pytest.approx(MOST["drop"], abs=1.0)
    one = intervals(EFFECTS["random_dropout"], problem, found)["probability"]
    assert one.low < share + 0.01
    assert one.high > share - 0.01
    assert one.high - one.low < 0.04
