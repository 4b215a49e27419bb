"""Mean errors do not see scatter and lattices; likelihoods do."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxsim.discover.distance import distance, of_lattices
from jaxsim.discover.likelihood import DEGREES

from .conftest import judged_toy


@pytest.fixture(scope="module")
def judged(standard_promotion):
    return judged_toy()


def test_errors_are_those_of_the_residuals_and_likelihoods_those_of_their_law(judged):
    found, fitted, unit = judged
    told = distance(found, fitted, found.weights, unit)
    # The toy's sensor has range noise of 2 cm and loses one ray in a hundred.
    np.testing.assert_allclose(told.error[:, 1].mean(), 0.02 * np.sqrt(2 / np.pi), rtol=0.1)
    rays = 30 * 16
    law = stats.t(DEGREES, scale=0.86 * 0.02)
    expected = rays * law.logpdf(np.random.default_rng(0).normal(0, 0.02, 100_000)).mean()
    np.testing.assert_allclose(told.log_likelihood[:, 1].mean(), expected, rtol=0.1)
    chance = np.array([0.01, 0.99])
    np.testing.assert_allclose(told.log_likelihood[:, 2].mean(), rays * (chance * np.log(chance)).sum(), rtol=0.6)


def test_noise_of_the_right_size_gains_and_errors_stay(judged):
    found, fitted, unit = judged
    loud = replace(found, noise=replace(found.noise, range_=found.noise.range_ + 0.7))
    right, wrong = (distance(one, fitted, found.weights, unit) for one in (found, loud))
    assert (right.log_likelihood - wrong.log_likelihood)[:, 1].min() > 20
    np.testing.assert_array_equal(right.error[:, 1], wrong.error[:, 1])


def test_readings_on_the_lattice_gain_its_step_and_others_lose(judged):
    ev = judged[0].ev
    on = replace(ev, range_m=jnp.round(ev.range_m / 0.05) * 0.05)
    stepped = [replace(one, rays=replace(one.rays, range_step_m=jnp.float32(0.05))) for one in (on, ev)]
    returned = np.asarray(ev.returned).sum((1, 2))
    np.testing.assert_allclose(of_lattices(stepped[0])[:, 1], returned * np.log(0.995 * 50), rtol=1e-6)
    assert (of_lattices(stepped[1])[:, 1] < -2 * returned).all()
    assert not of_lattices(ev).any()


def test_a_reading_of_nothing_lies_on_every_lattice_of_intensities(judged):
    ev = judged[0].ev
    dark = replace(ev, log_intensity=jnp.full_like(ev.log_intensity, np.log(1e-4)))
    dark = replace(dark, rays=jax.tree.map(lambda x: x, replace(ev.rays, intensity_step=jnp.float32(1 / 255))))
    assert (of_lattices(dark)[:, 0] > 0).all()
