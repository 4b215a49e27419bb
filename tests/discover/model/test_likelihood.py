"""Densities hold their probability: what a ray can do sums to one."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import t as student

from jaxsim.discover.model.gradients import CONSTANT, DIFFERENTIATED, value_and_gradient
from jaxsim.discover.model.likelihood import intensity_terms, log_below, return_terms, rounded, rounding_gain
from jaxsim.discover.model.noise import START
from jaxsim.discover.model.random_effects import normal_equations
from jaxsim.discover.show.gap import distance
from jaxsim.effects.effect import CHANNELS
from tests.discover.toy import judged_toy

BROAD = START.replace(range_=jnp.float32(np.log(0.2)))
"""Ranges so noisy that sums over steps of 0.1 m are integrals."""


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"log_keep": -0.7},
        {"log_keep": -50.0},
        {"between": 0.4, "between_m": 30.0},
        {"ghost": 0.2, "ghost_m": 5.0},
        {"clutter": 0.3, "clutter_power": -2.0, "clutter_scale_m": 15.0, "clutter_from_m": 1.5},
    ],
    ids=["plain", "half kept", "lost", "between", "ghost", "clutter"],
)
def test_no_return_and_all_ranges_together_have_probability_one(evidence, change):
    total = total_probability(evidence, change)
    surrounded = np.isfinite(np.asarray(evidence.rays.beside_m)).all(-1)
    for edge in (False, True):
        asked = np.asarray(evidence.rays.hit & (evidence.edge == edge)) & surrounded
        assert asked.any()
        assert np.quantile(np.abs(total[asked] - 1), 0.95) < 0.03


@pytest.mark.parametrize("hidden", [1, 3, 4])
@pytest.mark.parametrize("change", [{}, {"log_keep": -0.7}], ids=["plain", "half kept"])
def test_beside_the_sky_all_that_a_ray_can_do_has_probability_one_too(evidence, hidden, change):
    """So many of the neighbours hit nothing."""
    beside = evidence.rays.beside_m.at[..., :hidden].set(jnp.inf)
    total = total_probability(replace(evidence, rays=replace(evidence.rays, beside_m=beside)), change)
    asked = np.asarray(evidence.rays.hit & evidence.edge)
    assert asked.any()
    assert np.quantile(np.abs(total[asked] - 1), 0.95) < 0.03


def total_probability(evidence, change):
    """Of each ray: that it does not return, or returns anywhere."""
    rays = replace(evidence.rays, **{k: jnp.full(evidence.edge.shape, v, jnp.float32) for k, v in change.items()})
    w = normal_equations(evidence, START, (jnp.zeros(evidence.edge.shape),) * 2)
    # Weights of 0: no pose is fitted to the ranges that are swept here.
    w = w.replace(range_=w.range_ * 0)
    at = np.concatenate([np.arange(0.05, 40, 0.1), np.arange(40, 400, 2.0)])
    lost, density = _swept(rays, replace(evidence, returned=evidence.returned | True), w, at.astype(np.float32))
    return np.tensordot(np.gradient(at), np.asarray(density, float), 1) + np.exp(np.asarray(lost, float))


def test_at_an_edge_a_reading_may_lie_anywhere_before_the_surface_but_not_behind(evidence):
    """A beam of some width meets there what single rays pass by."""
    zero = jnp.zeros(evidence.edge.shape)
    w = normal_equations(evidence, START, (zero, zero))
    w = w.replace(range_=w.range_ * 0)
    rays = evidence.rays.replace(beside_m=jnp.full_like(evidence.rays.beside_m, jnp.inf))
    ev = replace(evidence, returned=evidence.returned | True)

    def at(share):
        one = replace(ev, range_m=share * rays.range_m)
        return np.asarray(return_terms(rays, one, START, equations=w, clutter=False)[1])

    far = np.asarray(rays.hit) & (np.asarray(rays.range_m) > 15)
    edge = np.asarray(evidence.edge) & far
    plain = far & ~np.asarray(evidence.edge)
    assert (at(0.5)[edge] > at(1.5)[edge] + 1).all()
    np.testing.assert_allclose(at(0.25)[edge], at(0.5)[edge], atol=0.3)
    np.testing.assert_allclose(at(0.5)[plain], at(1.5)[plain], atol=0.01)


def test_what_hides_a_post_does_not_hide_what_a_ray_beside_it_reads(evidence):
    """A gate, a sector: the simulated ray meets the post, the measured one what stands behind."""
    zero = jnp.zeros(evidence.edge.shape)
    w = normal_equations(evidence, START, (zero, zero)).replace(range_=zero)
    around = evidence.rays.beside_m
    behind = jnp.where(jnp.isfinite(around).all(-1), around.max(-1), 0)
    ev = replace(evidence, returned=evidence.returned | True, range_m=behind)

    def at(keep):
        post = {"range_m": behind / 2, "reading_m": behind / 2, "log_keep": jnp.full_like(behind, keep)}
        return np.asarray(return_terms(evidence.rays.replace(**post), ev, START, equations=w, clutter=False)[1])

    hit = np.asarray(evidence.rays.hit) & (np.asarray(behind) > 10)
    other, plain = hit & np.asarray(evidence.edge), hit & ~np.asarray(evidence.edge)
    assert other.any()
    np.testing.assert_allclose(at(-50.0)[other], at(0.0)[other], atol=0.5)
    assert (at(-50.0)[plain] < at(0.0)[plain] - 6).all()


@jax.jit
def _swept(rays, ev, w, at):
    """ln P of no return, and the density at each of these ranges, of all rays."""

    def terms(r):
        one = replace(ev, range_m=jnp.full(ev.edge.shape, r))
        return return_terms(rays, one, BROAD, equations=w, clutter=True)

    return terms(at[0])[0], jax.lax.map(lambda r: jnp.exp(terms(r)[1]), at)


def test_the_right_gain_is_more_likely_than_a_wrong_one_and_a_constant_gain_is_free(evidence):
    zero = jnp.zeros(evidence.edge.shape)
    w = normal_equations(evidence, START, (zero, zero))

    def total(change):
        rays = replace(evidence.rays, log_intensity=evidence.rays.log_intensity + change)
        return float(intensity_terms(rays, evidence, START, equations=w, in_fit=jnp.ones(6))[0].sum())

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
            fields, constant, evidence, noise=START, equations=w, in_fit=one, counted=one, channels=asked
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
    w, in_fit = normal_equations(evidence, START, (zero, zero)), jnp.zeros(6)
    dark = replace(evidence, log_intensity=jnp.full_like(evidence.log_intensity, float(np.log(1e-4))))
    dim = replace(evidence.rays, log_intensity=zero + evidence.lowest - 0.5)
    bright = replace(evidence.rays, log_intensity=zero - 0.5)
    w = w.replace(intensity=w.intensity * 0)
    near, far = (intensity_terms(rays, dark, START, equations=w, in_fit=in_fit)[0] for rays in (dim, bright))
    counted = np.asarray(evidence.compared)
    assert np.asarray(near)[counted].min() > -1
    assert np.asarray(far)[counted].max() < -3
    lifted = replace(dark, log_intensity=dark.log_intensity + 0.1, lift=zero + 0.1)
    same = intensity_terms(dim, lifted, START, equations=w, in_fit=in_fit)[0]
    assert np.asarray(same)[counted].min() > -1


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
    found, in_fit, unit = judged
    ev = replace(found.ev, range_m=jnp.round(found.ev.range_m / STEP_M) * STEP_M)
    stepped = replace(ev, rays=replace(ev.rays, range_step_m=jnp.float32(STEP_M)))
    plain, on = [distance(replace(found, ev=one), in_fit, found.equations, scene=unit) for one in (ev, stepped)]
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
