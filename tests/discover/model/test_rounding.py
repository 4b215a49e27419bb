"""What readings gain by lying on a lattice: the same for naming and for judging."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.gap import distance
from jaxsim.discover.model.rounding import rounded, rounding_gain
from tests.discover.toy import judged_toy

STEP_M = 0.05


@pytest.fixture(scope="module")
def judged(standard_promotion):
    return judged_toy()


def test_readings_on_the_lattice_gain_its_step_and_others_lose(judged):
    ev = judged[0].ev
    on = replace(ev, range_m=jnp.round(ev.range_m / STEP_M) * STEP_M)
    returned = np.asarray(ev.returned).sum((1, 2))
    steps = rounded(on)
    assert steps == {"range_quantization": pytest.approx(STEP_M, rel=1e-4)}
    assert not rounded(ev)
    np.testing.assert_allclose(rounding_gain(on, steps)[:, 1], returned * np.log(0.995 * STEP_M / 1e-3), rtol=1e-4)
    assert (rounding_gain(ev, steps)[:, 1] < -2 * returned).all()
    assert not rounding_gain(on, {}).any()


def test_the_likelihood_of_judge_scenes_counts_the_lattice_that_the_rays_have(judged):
    found, fitted, unit = judged
    ev = replace(found.ev, range_m=jnp.round(found.ev.range_m / STEP_M) * STEP_M)
    stepped = replace(ev, rays=replace(ev.rays, range_step_m=jnp.float32(STEP_M)))
    plain, on = [distance(replace(found, ev=one), fitted, found.equations, scene=unit) for one in (ev, stepped)]
    returned = np.asarray(ev.returned)[unit >= 6].sum((1, 2))
    assert ((on.log_likelihood - plain.log_likelihood)[:, 1] > returned).all()


def test_a_reading_of_nothing_lies_on_every_lattice_of_intensities(judged):
    ev = judged[0].ev
    dark = replace(ev, log_intensity=jnp.full_like(ev.log_intensity, np.log(1e-4)))
    assert (rounding_gain(dark, {"intensity_quantization": 1 / 255})[:, 0] > 0).all()


def test_a_lattice_is_read_off_the_readings_not_off_what_noise_makes_of_their_logarithms(judged):
    """A simulator with constant noise lifts the logarithms of dark readings."""
    ev = judged[0].ev
    step = 2 / 255
    reading = jnp.maximum(jnp.round(jnp.exp(ev.log_intensity) / step), 1) * step
    lift = 0.5 * jnp.minimum(0.008 / reading, 0.5) ** 2
    noisy = replace(ev, log_intensity=jnp.log(reading) + lift, lift=lift)
    assert rounded(noisy)["intensity_quantization"] == pytest.approx(step, rel=1e-4)
    assert "intensity_quantization" not in rounded(replace(noisy, lift=jnp.zeros_like(lift)))
