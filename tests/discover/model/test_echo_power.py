"""What is fitted to reported intensities and to powers that are not known exactly."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.evidence import gather
from jaxsim.discover.model.fit import on_top
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.model.parameters import to_z
from jaxsim.effects import EFFECTS
from tests.discover.toy import device, toy

pytestmark = pytest.mark.usefixtures("standard_promotion")
FRAMES = np.arange(3)


@pytest.fixture(scope="module")
def problem(standard_promotion):
    scan, measured = device(*toy(frames=3, seed=2))
    ev = gather(scan, measured, FRAMES, np.broadcast_to(np.arange(0, 60, 3), (3, 20)), FRAMES)
    return fit_null(scan, ev, np.ones(3, np.float32))[0]


def test_a_walk_follows_the_reported_intensity_where_there_is_one_and_the_predicted_in_a_simulation(problem):
    walk, ev = EFFECTS["range_walk"], problem.ev
    z = to_z(walk, {"amplitude_m": 0.2, "intensity": 0.3}, ev.rays.row.shape[-1])
    predicted, returned = np.exp(ev.rays.log_intensity), np.asarray(ev.returned)
    reported = np.where(returned, np.exp(ev.log_intensity), predicted)
    assert np.abs(reported - predicted)[returned].max() > 0.05
    hit = np.asarray(ev.rays.hit)
    for simulated, light in ((False, reported), (True, predicted)):
        after = on_top(walk, problem, z, simulated=simulated).ev.rays
        moved = np.asarray(after.reading_m - ev.rays.reading_m)
        np.testing.assert_allclose(moved[hit], (0.2 * np.exp(-light / 0.3))[hit], atol=1e-4)
        np.testing.assert_array_equal(after.log_intensity, ev.rays.log_intensity)


def test_a_threshold_on_an_uncertain_power_loses_the_mean_share(problem):
    p = {"threshold": jnp.float32(-4.0), "width": jnp.float32(0.4)}
    draws = np.random.default_rng(0).normal(0, 0.8, 20_000)
    for power in (-6.0, -4.5, -4.0, -3.0):
        rays = replace(problem.ev.rays, log_power=jnp.full((1,), power), log_power_sd=jnp.full((1,), 0.8))
        rays = replace(rays, log_keep=jnp.zeros(1))
        kept = float(jnp.exp(EFFECTS["snr_dropout"].apply(p, rays, problem.scan).log_keep[0]))
        assert kept == pytest.approx(np.mean(1 / (1 + np.exp(-(power + draws + 4.0) / 0.4))), abs=0.02)
