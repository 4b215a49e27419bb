"""Effects fitted beside one another have the numbers that each was planted with; alone each takes up the other's."""

from dataclasses import replace

import numpy as np
import pytest

from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.fit import fit
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.model.parameters import to_values, to_z
from jaxsim.discover.model.together import in_place, refit, refitted
from jaxsim.effects import EFFECTS
from tests.discover.toy import device, toy

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = np.arange(8)
EVERYONE = np.ones(8, np.float32)
LOST, OF_WALLS = 0.15, 0.4
WALL = 11
RANDOM, BY_CLASS = EFFECTS["random_dropout"], EFFECTS["material_dropout"]


@pytest.fixture(scope="module")
def problem():
    """The null of streets in which some of all rays are lost, and more of those that meet a wall."""
    scan, measured = toy(frames=8, seed=21)
    random = np.random.default_rng(22).random((2, *measured.valid.shape))
    kept = (random[0] >= LOST) & ((random[1] >= OF_WALLS) | (np.asarray(scan.semantic) != WALL))
    scan, measured = device(scan, replace(measured, valid=measured.valid & kept))
    ev = gather(scan, measured, frame=FRAMES, column=np.broadcast_to(np.arange(0, 60, 2), (8, 30)), scene=FRAMES)
    return fit_null(scan, ev, EVERYONE)[0]


def share(effect, z, place=()) -> float:
    return float(np.asarray(to_values(effect, z)["probability"])[place])


def test_what_the_first_took_up_goes_to_the_second(problem):
    alone = fit(RANDOM, problem, EVERYONE)
    assert share(RANDOM, alone.z) > LOST + 0.05
    begun = fit(BY_CLASS, refitted(in_place(problem, [(RANDOM, alone.z)])), EVERYONE)
    random, by_class = refit(problem, [RANDOM, BY_CLASS], [alone.z, begun.z])
    wrong = abs(share(BY_CLASS, begun.z, WALL) - OF_WALLS)
    assert abs(share(RANDOM, random.fit.z) - LOST) < 0.04
    assert abs(share(BY_CLASS, by_class.fit.z, WALL) - OF_WALLS) < min(0.06, wrong)
    # Each was fitted on rays that carry the other.
    beside = in_place(problem, [(RANDOM, random.fit.z)])
    np.testing.assert_array_equal(by_class.problem.ev.rays.log_keep, beside.ev.rays.log_keep)


def test_effects_are_put_in_place_in_physical_order(problem):
    names = ("beam_gain", "range_falloff")
    z = {name: fit(EFFECTS[name], problem, EVERYONE).z for name in names}
    light = [
        in_place(problem, [(EFFECTS[name], z[name]) for name in order]).ev.rays.log_intensity
        for order in (names, names[::-1])
    ]
    np.testing.assert_array_equal(*light)


def test_beside_the_others_an_effect_is_looked_for_at_its_own_starts_too():
    """A gate that was left open has no slope towards where it is."""
    nearest_m = 6.0
    scan, measured = toy(frames=8, seed=21)
    lost = np.random.default_rng(22).random(measured.valid.shape) < LOST
    kept = ~lost & (np.asarray(scan.range_m) > nearest_m)
    scan, measured = device(scan, replace(measured, valid=measured.valid & kept))
    ev = gather(scan, measured, frame=FRAMES, column=np.broadcast_to(np.arange(0, 60, 2), (8, 30)), scene=FRAMES)
    null, _ = fit_null(scan, ev, EVERYONE)
    gate = EFFECTS["range_gate"]
    random, shut = refit(null, [RANDOM, gate], [to_z(RANDOM, {"probability": 0.1}, 16), to_z(gate, {}, 16)])
    assert abs(share(RANDOM, random.fit.z) - LOST) < 0.04
    assert to_values(gate, shut.fit.z)["minimum_m"] == pytest.approx(nearest_m, abs=0.3)
    # From where it was left alone it would have stayed there.
    left = fit(gate, shut.problem, EVERYONE, starts=({},))
    assert to_values(gate, left.z)["minimum_m"] == 0
