"""What frames could show, against closed forms that one can write down."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.evidence import POSE_SD
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise import MOST
from jaxsim.discover.rules import RULES
from jaxsim.discover.show.sensitivity import (
    OF_MEAN,
    _times,
    could_pass,
    expected_gains,
    needed_nats,
    sensitivities,
    sensitivity,
)
from jaxsim.effects import EFFECTS
from tests.discover.toy import judged_toy

pytestmark = pytest.mark.usefixtures("standard_promotion")


@pytest.fixture(scope="module")
def problem() -> Problem:
    return judged_toy()[0]


@pytest.mark.long
def test_a_turn_of_all_frames_gains_what_their_poses_would_have_to_pay(problem):
    """Each frame's own pose could take it all up: then what is left is the price of the prior, half a square."""
    turn = 0.0005
    held, free = expected_gains(problem, EFFECTS["extrinsic_rotation"], {"pitch_rad": turn})
    assert held.min() > 20
    np.testing.assert_allclose(free, 0.5 * OF_MEAN * (turn / POSE_SD[4]) ** 2, rtol=0.15)


def test_gains_of_the_beams_cost_the_null_half_their_squares(problem):
    gain = np.random.default_rng(0).normal(0, 0.05, 16)
    held, free = expected_gains(problem, EFFECTS["beam_gain"], {"gain": gain})
    ev = problem.ev
    change = np.where(np.asarray(ev.compared), gain[np.asarray(ev.rays.row)], 0)
    weight = np.asarray(problem.equations.intensity)
    np.testing.assert_allclose(held, OF_MEAN * (0.5 * weight * change**2).sum((1, 2)), rtol=1e-3)
    # Levels take up the mean, and a part of what single strips see; not most of it.
    assert 0.3 * held.sum() < free.sum() < held.sum()


def test_a_gain_of_all_rays_is_no_effect(problem):
    """The overall gain is free, so that the first frame's level is: only what changes with time is left."""
    same = replace(problem.ev.rays, time_s=jnp.full_like(problem.ev.rays.time_s, 60.0))
    still = replace(problem, ev=replace(problem.ev, rays=same))
    held, free = expected_gains(still, EFFECTS["emitter_drift"], {"rate": 0.2})
    assert free.sum() < 0.01 * held.sum()


def test_what_is_lost_counts_by_its_divergence_from_the_most_that_is_usual(problem):
    p = 0.1
    _, free = expected_gains(problem, EFFECTS["random_dropout"], {"probability": p})
    ev, expected = problem.ev, 0.0
    stepped = np.asarray(ev.edge | ev.step)
    for place, most, own in (
        (~stepped, MOST["drop"], problem.noise.drop),
        (stepped, MOST["drop_edge"], problem.noise.drop_edge),
    ):
        usual, lost = 1 / (1 + np.exp(-most)), p + (1 - p) / (1 + np.exp(-float(own)))
        each = lost * np.log(lost / usual) + (1 - lost) * np.log((1 - lost) / (1 - usual))
        expected += each * (place & np.asarray(ev.rays.hit)).sum()
    assert free.sum() == pytest.approx(expected, rel=0.02)


def test_a_scatter_that_the_null_has_itself_is_no_effect(problem):
    """Where all echoes are as strong, range_noise is the scale of ranges by another name."""
    ev = problem.ev
    even = replace(problem, ev=replace(ev, rays=replace(ev.rays, log_power=jnp.full_like(ev.rays.log_power, -2.0))),
                   noise=replace(problem.noise, aim=np.float32(-20.0)))  # fmt: skip
    held, free = expected_gains(even, EFFECTS["range_noise"], {"sd_m": 0.01})
    assert held.sum() > 20
    assert free.sum() < 0.05 * held.sum()
    _, dark = expected_gains(problem, EFFECTS["range_noise"], {"sd_m": 0.01})
    assert dark.sum() > free.sum()


def test_gains_grow_as_the_square_of_a_size_which_the_multiple_undoes(problem):
    one = sensitivity(problem, EFFECTS["range_falloff"])
    values = {name: size * one.times for name, size in one.size.items()}
    _, free = expected_gains(problem, EFFECTS["range_falloff"], values)
    assert could_pass(EFFECTS["range_falloff"], 1.05 * free, rows=16)
    assert not could_pass(EFFECTS["range_falloff"], 0.9 * free, rows=16)
    assert one.smallest == {"exponent": pytest.approx(values["exponent"])}


@pytest.mark.parametrize(("effect", "word"), [("retroreflection", "surfaces"), ("emitter_drift", "longer")])
def test_what_no_ray_shows_is_told_with_what_to_record(problem, effect, word):
    """A road and a wall: no signs; and frames of one moment."""
    rays = replace(problem.ev.rays, time_s=jnp.zeros_like(problem.ev.rays.time_s))
    one = sensitivity(replace(problem, ev=replace(problem.ev, rays=rays)), EFFECTS[effect])
    assert not one.testable
    assert one.times is None
    assert one.smallest == {}
    assert one.why == "hardly a ray that was compared changes by it"
    assert word in one.record


def test_what_rounding_leaves_is_no_gain():
    """Sums over rays that an effect does not touch end near zero, on one processor at it and on another beside it."""
    assert not could_pass(EFFECTS["packet_loss"], np.full(10, 4e-7), rows=16)
    assert _times(np.full(10, 4e-7), needed=10.5) is None


def test_a_border_is_asked_where_it_does_something(problem):
    """At half of its way from nothing no threshold loses a ray."""
    gate = sensitivity(problem, EFFECTS["range_gate"])
    assert gate.testable
    assert gate.times <= 1


def test_few_scenes_must_say_very_much():
    effect = EFFECTS["packet_loss"]
    need = needed_nats(effect, 16)
    assert need == RULES.bar_nats + 0.5
    many, few = np.full(10, 1.5), np.array([0.0] * 7 + [13.0] * 3)
    assert could_pass(effect, many, rows=16)
    assert could_pass(effect, few, rows=16)
    assert not could_pass(effect, few / 1.5, rows=16)
    assert not could_pass(effect, many / 2, rows=16)


def test_the_least_comes_first_and_lattices_are_not_asked(problem):
    some = [EFFECTS[name] for name in ("beam_range_bias", "intensity_quantization", "retroreflection", "range_falloff")]
    told = sensitivities(problem, some)
    assert told[0].name == "retroreflection"
    assert {one.name for one in told} == {"beam_range_bias", "retroreflection", "range_falloff"}
    assert all(np.isfinite(one.nats) for one in told)
