"""Variances that follow from the noise scales."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import norm, t

from jaxsim.discover.model.noise import DEGREES, LEAST, MOST, NORMAL, START, intensity_variance, reading_variance


def test_noise_of_normals_counts_as_the_slope_of_lamberts_law(evidence):
    angle, off = 1.0, 1e-3
    tilted = replace(evidence, given_rad=jnp.full_like(evidence.given_rad, angle))
    slope = (np.log(np.cos(angle + off)) - np.log(np.cos(angle - off))) / (2 * off)
    expected = np.exp(2 * START.intensity) + (slope * np.exp(START.normals)) ** 2
    np.testing.assert_allclose(intensity_variance(tilted, START), expected, rtol=1e-4)


def test_only_edges_have_the_noise_of_edges(evidence):
    variance = np.asarray(reading_variance(evidence.rays, evidence, START))
    quiet = np.asarray(reading_variance(evidence.rays, evidence, START.replace(edge=jnp.float32(-20.0))))
    edge = np.asarray(evidence.edge)
    assert edge.any()
    np.testing.assert_allclose((variance - quiet)[edge], np.exp(2 * START.edge), rtol=1e-3)
    np.testing.assert_array_equal(variance[~edge], quiet[~edge])


def test_a_step_scatters_readings_as_a_uniform_law_does(evidence):
    rounded = replace(evidence.rays, range_step_m=jnp.float32(0.2))
    readings = np.random.default_rng(0).uniform(-0.1, 0.1, 100_000)
    more = reading_variance(rounded, evidence, START) - reading_variance(evidence.rays, evidence, START)
    np.testing.assert_allclose(np.asarray(more)[~np.asarray(evidence.edge)], readings.var(), rtol=0.02)


def test_a_student_fitted_to_normal_noise_has_the_scale_that_noise_of_effects_adds():
    x = np.linspace(-8, 8, 4001)
    law = norm.pdf(x) * (x[1] - x[0])
    alone = minimize_scalar(lambda s: -law @ t.logpdf(x, DEGREES, scale=s), bounds=(0.3, 2), method="bounded").x
    assert alone - 0.02 < NORMAL < 0.89 + 0.02


def test_fits_may_begin_where_they_begin():
    # SciPy cuts a start to its bounds; only lost rays at edges begin beyond theirs.
    beyond = [name for name, most in MOST.items() if getattr(START, name) > most]
    assert beyond == ["drop_edge"]
    assert all(getattr(START, name) >= least for name, least in LEAST.items())
