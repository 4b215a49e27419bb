"""What both sides have alike at the same rays is noise of neither."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.noise_levels import noise_levels
from jaxsim.discover.model.own_noise import common_variance, own_levels
from tests.discover.noisy_street import scan, sensed

NOISY = {"share": 0.06, "constant": 0.008, "range_m": 0.015, "loss": 0.01}
LEVELS = ("range_m", "intensity", "intensity_share", "loss")


def beside(simulated, measured):
    """What a sensor read, with the simulator's surfaces."""
    return replace(simulated, range_m=measured.range_m, intensity=measured.intensity, hit=measured.valid)


def read_again(simulated, *, range_m=0.0, gain=1.0, share=0.0, loss=0.0):
    """A sensor that reads what is simulated, noise and all, with noise of its own on top."""
    rng = np.random.default_rng(3)
    shape = simulated.range_m.shape
    hit = np.asarray(simulated.hit) & (rng.random(shape) >= loss)
    reading = np.asarray(simulated.range_m) + range_m * rng.normal(size=shape)
    intensity = gain * np.asarray(simulated.intensity) * (1 + share * rng.normal(size=shape))
    kept = {"range_m": np.where(hit, reading, 0), "intensity": np.where(hit, intensity, 0)}
    return replace(simulated, hit=jnp.asarray(hit), **{name: jnp.asarray(v, "f4") for name, v in kept.items()})


def test_independent_noise_stays_what_each_side_s_own_frames_say():
    simulated, truth = scan(NOISY)
    measured = beside(simulated, sensed(truth, NOISY | {"range_m": 0.03}))
    ours, theirs = own_levels(simulated, measured)
    assert ours == noise_levels(simulated)
    assert theirs == noise_levels(measured)


def test_readings_of_one_scan_on_both_sides_have_no_noise():
    simulated, _ = scan(NOISY)
    assert all(getattr(noise_levels(simulated), name) > 0 for name in LEVELS)
    for side in own_levels(simulated, read_again(simulated, gain=0.7)):
        assert [getattr(side, name) for name in LEVELS] == [0, 0, 0, 0]


def test_what_a_sensor_adds_to_the_readings_is_its_own():
    simulated, _ = scan(NOISY)
    ours, theirs = own_levels(simulated, read_again(simulated, range_m=0.04, share=0.1))
    assert [getattr(ours, name) for name in LEVELS] == [0, 0, 0, 0]
    assert theirs.range_m == pytest.approx(0.04, rel=0.1)
    assert theirs.intensity_share == pytest.approx(0.1, rel=0.3)


def test_losses_of_its_own_stay_beside_readings_in_common():
    simulated, _ = scan({"range_m": 0.015})
    lossy = read_again(simulated, loss=0.02)
    # The exchanged sides: what loses is now the simulator.
    ours, _ = own_levels(lossy, simulated)
    assert ours.loss == pytest.approx(0.02, rel=0.2)
    assert ours.range_m == 0


def test_a_lesser_common_part_is_left_in_the_noise():
    rng = np.random.default_rng(5)
    common, own, other = rng.normal(size=(3, 20000))
    mostly = common_variance(2 * common + own, 2 * common + other)
    assert mostly == pytest.approx(4, rel=0.1)
    assert common_variance(0.5 * common + own, 0.5 * common + other) == 0
    # All of theirs may be common, and little of ours.
    assert common_variance(common + 2 * own, common) == 0


def test_too_few_rays_of_both_sides_tell_nothing_in_common():
    simulated, _ = scan(NOISY)
    measured = read_again(simulated)
    few = measured.hit & (np.arange(measured.hit.shape[2]) < 6)[None, None]
    ours, _ = own_levels(simulated, replace(measured, hit=few))
    assert ours.range_m == noise_levels(simulated).range_m > 0
