"""What the null model finds in a sensor that lacks nothing, and in powers that are not known exactly; effects
fitted beside one another have the numbers that each was planted with, and alone each takes up the other's."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.fit import fit, in_place
from jaxsim.discover.model.null_model import (
    as_implied,
    fit_null,
    implied_level,
    refit,
    refitted,
    residual_spread,
    residuals,
    standardised,
)
from jaxsim.discover.model.parameters import to_values, to_z
from jaxsim.discover.model.random_effects import shared_levels
from jaxsim.effects import EFFECTS
from jaxsim.effects.effect import CHANNELS
from tests.discover.toy import device, judged_toy, toy

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = np.arange(8)
LOST, OF_WALLS = 0.15, 0.4
WALL = 11
RANDOM, BY_CLASS = EFFECTS["random_dropout"], EFFECTS["material_dropout"]


@pytest.fixture(scope="module")
def problem(standard_promotion):
    return judged_toy()[0]


def test_the_null_finds_the_noise_and_the_gain_of_the_sensor(problem):
    # A Student-t of 4 degrees that is fitted to normal noise has 0.86 of its scale; levels of strips, of which each
    # holds but a few rays here, take up another tenth or two.
    assert 0.65 * 0.08 < np.exp(problem.noise.intensity) < 0.9 * 0.08
    assert np.exp(problem.noise.range_) == pytest.approx(0.85 * 0.02, rel=0.15)
    gain = np.asarray(shared_levels(problem.ev, problem.equations, jnp.ones(9)))[: -problem.ev.after_kinds]
    np.testing.assert_allclose(gain[0] + gain[1:], np.log(1.2), atol=0.03)


def test_powers_are_as_uncertain_as_intensities_scatter_and_surfaces_differ(problem):
    level = implied_level(problem.ev, problem.equations)
    hit = np.asarray(problem.ev.rays.hit)
    assert level[hit].mean() == pytest.approx(np.log(1.2), abs=0.03)
    assert not level[~hit].any()
    implied = as_implied(problem.ev, problem.noise, problem.equations)
    np.testing.assert_allclose(implied.rays.log_power - problem.ev.rays.log_power, level, atol=1e-5)
    known, unknown = np.asarray(implied.rays.log_power_sd), np.asarray(problem.ev.rays.log_power_sd)
    np.testing.assert_allclose(unknown**2 - known**2, level[hit].var(), rtol=0.02, atol=1e-5)


def test_a_threshold_on_an_uncertain_power_loses_the_mean_share(problem):
    # Of the law's other form, a loss of dark readings, nothing.
    values = {"threshold": -4.0, "width": 0.4, "limit": 0.5, "zero_loss": 0.0}
    p = {name: jnp.float32(value) for name, value in values.items()}
    draws = np.random.default_rng(0).normal(0, 0.8, 20_000)
    for power in (-6.0, -4.5, -4.0, -3.0):
        rays = replace(problem.ev.rays, log_power=jnp.full((1,), power), log_power_sd=jnp.full((1,), 0.8))
        rays = replace(rays, log_keep=jnp.zeros(1), log_intensity=jnp.zeros(1))
        kept = float(jnp.exp(EFFECTS["snr_dropout"].apply(p, rays).log_keep[0]))
        assert kept == pytest.approx(np.mean(1 / (1 + np.exp(-(power + draws + 4.0) / 0.4))), abs=0.02)


@pytest.fixture(scope="module")
def null(standard_promotion):
    problem, in_fit, _ = judged_toy()
    return problem, in_fit


def test_each_channel_is_standardised_where_it_counts_and_keeps_its_unit(null):
    by_channel = residuals(*null)
    assert tuple(by_channel) == CHANNELS
    for one in by_channel.values():
        assert one.counts.any()
        assert np.isfinite(one.z[one.counts]).all()
        assert one.z[one.counts].std() == pytest.approx(1, abs=1e-3)
    # The toy's sensor has 8 % and 2 cm; levels and poses take up a little.
    assert by_channel["intensity"].off[by_channel["intensity"].counts].std() == pytest.approx(0.08, rel=0.2)
    assert by_channel["range"].off[by_channel["range"].counts].std() == pytest.approx(0.02, rel=0.2)


def test_a_lost_ray_is_off_by_the_probability_that_it_returns(null):
    problem, _ = null
    drop = residuals(*null)["drop"]
    p, lost = np.asarray(residual_spread(problem.ev, problem.noise)[2]), ~np.asarray(problem.ev.returned)
    np.testing.assert_allclose(drop.off, np.where(lost, 1 - p, -p), atol=1e-6)
    np.testing.assert_array_equal(np.sign(drop.z[drop.counts]), np.where(lost, 1, -1)[drop.counts])


def test_the_standardised_ones_are_on_the_host(null):
    problem, _ = null
    rays, by_channel = standardised(problem)
    assert isinstance(rays.range_m, np.ndarray)
    for name, one in residuals(problem, problem.ev.all_blocks).items():
        np.testing.assert_array_equal(by_channel[name][0], one.z)


@pytest.fixture(scope="module")
def lossy():
    """The null of streets in which some of all rays are lost, and more of those that meet a wall."""
    scan, measured = toy(frames=8, seed=21)
    random = np.random.default_rng(22).random((2, *measured.valid.shape))
    kept = (random[0] >= LOST) & ((random[1] >= OF_WALLS) | (np.asarray(scan.semantic) != WALL))
    scan, measured = device(scan, replace(measured, valid=measured.valid & kept))
    ev = gather(scan, measured, frame=FRAMES, column=np.broadcast_to(np.arange(0, 60, 2), (8, 30)), scene=FRAMES)
    return fit_null(scan, ev)


def share(effect, z, place=()) -> float:
    return float(np.asarray(to_values(effect, z)["probability"])[place])


@pytest.mark.long
def test_what_the_first_took_up_goes_to_the_second(lossy):
    alone = fit(RANDOM, lossy)
    assert share(RANDOM, alone.z) > LOST + 0.05
    begun = fit(BY_CLASS, refitted(in_place(lossy, [(RANDOM, alone.z)])))
    random, by_class = refit(lossy, [RANDOM, BY_CLASS], [alone.z, begun.z])
    wrong = abs(share(BY_CLASS, begun.z, WALL) - OF_WALLS)
    assert abs(share(RANDOM, random.fit.z) - LOST) < 0.04
    assert abs(share(BY_CLASS, by_class.fit.z, WALL) - OF_WALLS) < min(0.06, wrong)
    # Each was fitted on rays that carry the other.
    beside = in_place(lossy, [(RANDOM, random.fit.z)])
    np.testing.assert_array_equal(by_class.problem.ev.rays.log_keep, beside.ev.rays.log_keep)


@pytest.mark.long
def test_beside_the_others_an_effect_is_looked_for_at_its_own_starts_too():
    """A gate that was left open has no slope towards where it is."""
    nearest_m = 6.0
    scan, measured = toy(frames=8, seed=21)
    lost = np.random.default_rng(22).random(measured.valid.shape) < LOST
    kept = ~lost & (np.asarray(scan.range_m) > nearest_m)
    scan, measured = device(scan, replace(measured, valid=measured.valid & kept))
    ev = gather(scan, measured, frame=FRAMES, column=np.broadcast_to(np.arange(0, 60, 2), (8, 30)), scene=FRAMES)
    null = fit_null(scan, ev)
    gate = EFFECTS["range_gate"]
    random, shut = refit(null, [RANDOM, gate], [to_z(RANDOM, {"probability": 0.1}, 16), to_z(gate, {}, 16)])
    assert abs(share(RANDOM, random.fit.z) - LOST) < 0.04
    assert to_values(gate, shut.fit.z)["minimum_m"] == pytest.approx(nearest_m, abs=0.3)
    # From where it was left alone it would have stayed there.
    left = fit(gate, shut.problem, starts=({},))
    assert to_values(gate, left.z)["minimum_m"] == 0
