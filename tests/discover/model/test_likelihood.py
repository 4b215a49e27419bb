"""Densities hold their probability: what a ray can do sums to one."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import t as student

from jaxsim.discover.model.gradients import CONSTANT, DIFFERENTIATED, value_and_gradient
from jaxsim.discover.model.likelihood import CHANNELS, intensity_terms, log_below, return_terms
from jaxsim.discover.model.noise import START
from jaxsim.discover.model.random_effects import normal_equations

BROAD = START.replace(range_=jnp.float32(np.log(0.2)))
"""Ranges so noisy that sums over steps of 0.1 m are integrals."""


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"log_keep": -0.7},
        {"between": 0.4, "between_m": 30.0},
        {"ghost": 0.2, "ghost_m": 5.0},
        {"clutter": 0.3, "clutter_power": -2.0, "clutter_scale_m": 15.0, "clutter_from_m": 1.5},
    ],
    ids=lambda change: next(iter(change), "plain"),
)
def test_no_return_and_all_ranges_together_have_probability_one(evidence, change):
    rays = replace(evidence.rays, **{k: jnp.full(evidence.edge.shape, v, jnp.float32) for k, v in change.items()})
    w = normal_equations(evidence, START, (jnp.zeros(evidence.edge.shape),) * 2)
    # Weights of 0: no pose is fitted to the ranges that are swept here.
    w = w.replace(range_=w.range_ * 0)
    at = np.concatenate([np.arange(0.05, 40, 0.1), np.arange(40, 400, 2.0)])
    mass = np.zeros(evidence.edge.shape)
    step = np.gradient(at)
    for r, width in zip(at, step, strict=True):
        one = replace(
            evidence, range_m=jnp.full(evidence.edge.shape, r, jnp.float32), returned=evidence.returned | True
        )
        lost, seen, _ = _terms(rays, one, w)
        mass += np.exp(np.asarray(seen, np.float64)) * width
    total = mass + np.exp(np.asarray(lost, np.float64))
    plain = np.asarray(evidence.rays.hit & ~evidence.edge)
    assert np.quantile(np.abs(total[plain] - 1), 0.95) < 0.03


def _terms(rays, ev, w):
    global _compiled
    import jax

    if _compiled is None:
        _compiled = jax.jit(lambda rays, ev, w: return_terms(rays, ev, BROAD, equations=w, clutter=True))
    return _compiled(rays, ev, w)


_compiled = None


def test_the_right_gain_is_more_likely_than_a_wrong_one_and_a_constant_gain_is_free(evidence):
    zero = jnp.zeros(evidence.edge.shape)
    w = normal_equations(evidence, START, (zero, zero))

    def total(change):
        rays = replace(evidence.rays, log_intensity=evidence.rays.log_intensity + change)
        return float(intensity_terms(rays, evidence, START, equations=w, fitted=jnp.ones(6))[0].sum())

    base = total(0.0)
    assert total(0.5) == pytest.approx(base, abs=0.5)
    assert total(0.5 * jnp.where(evidence.rays.row % 2 == 0, 1.0, -1.0)) < base - 50


def test_channels_that_are_not_asked_for_are_zero(evidence):
    zero = jnp.zeros(evidence.edge.shape)
    w = normal_equations(evidence, START, (zero, zero))
    fields = {name: getattr(evidence.rays, name) for name in DIFFERENTIATED}
    constant = {name: getattr(evidence.rays, name) for name in CONSTANT}
    one, by = jnp.ones(6), {}
    for asked in (("intensity",), ("range", "drop"), CHANNELS):
        value, blocks, by[asked], _ = value_and_gradient(
            fields, constant, evidence, noise=START, equations=w, fitted=one, counted=one, channels=asked
        )
        found = np.asarray(blocks)
        assert ((found != 0).all(0) == [channel in asked for channel in CHANNELS]).all()
        assert (found[:, [channel not in asked for channel in CHANNELS]] == 0).all()
        assert float(value) == pytest.approx(-found.sum(), rel=1e-5)
    for name, slope in by[CHANNELS].items():
        np.testing.assert_array_equal(slope, by["intensity",][name] + by["range", "drop"][name], err_msg=name)


def test_a_reading_of_nothing_has_the_probability_of_all_that_is_weaker():
    t = np.concatenate([-np.geomspace(1e3, 1e-2, 60), [0.0], np.geomspace(1e-2, 50, 30)])
    np.testing.assert_allclose(log_below(jnp.asarray(t, jnp.float32)), student.logcdf(t, 4), atol=0.06)


def test_a_zero_costs_little_where_the_simulation_is_as_dark_as_the_sensor_can_tell(evidence):
    zero = jnp.zeros(evidence.edge.shape)
    w, fitted = normal_equations(evidence, START, (zero, zero)), jnp.zeros(6)
    dark = replace(evidence, log_intensity=jnp.full_like(evidence.log_intensity, float(np.log(1e-4))))
    dim = replace(evidence.rays, log_intensity=zero + evidence.lowest - 0.5)
    bright = replace(evidence.rays, log_intensity=zero - 0.5)
    w = w.replace(intensity=w.intensity * 0)
    near, far = (intensity_terms(rays, dark, START, equations=w, fitted=fitted)[0] for rays in (dim, bright))
    counted = np.asarray(evidence.compared)
    assert np.asarray(near)[counted].min() > -1
    assert np.asarray(far)[counted].max() < -3
    lifted = replace(dark, log_intensity=dark.log_intensity + 0.1, lift=zero + 0.1)
    same = intensity_terms(dim, lifted, START, equations=w, fitted=fitted)[0]
    assert np.asarray(same)[counted].min() > -1
