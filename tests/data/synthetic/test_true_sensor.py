"""The true sensor against its formulae in float64, and light against geometry."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.data.synthetic.render import IdealScan
from jaxsim.data.synthetic.true_sensor import TrueSensor, Truth, beam_gain, measure, report
from jaxsim.frame import PolarImage
from jaxsim.geometry import preset

SPEC, SENSOR = preset("hdl64e"), TrueSensor()
SHAPE = (64, 200)


@pytest.fixture
def a_scan() -> IdealScan:
    rng = np.random.default_rng(0)
    chance = rng.random((3, *SHAPE))
    return IdealScan(
        range_m=rng.uniform(0.5, 140, SHAPE).astype(np.float32),
        valid=rng.random(SHAPE) < 0.9,
        incidence_rad=rng.uniform(0, 1.55, SHAPE).astype(np.float32),
        reflectance=rng.uniform(0.02, 0.8, SHAPE).astype(np.float32),
        glass=chance[0] < 0.1,
        retro=chance[1] < 0.05,
        absorbing=chance[2] < 0.1,
        marking=np.zeros(SHAPE, bool),
        wet=np.zeros(SHAPE, bool),
        semantic=np.full(SHAPE, 7, np.int32),
        instance=np.zeros(SHAPE, np.int32),
    )


def test_the_report_follows_its_formulae(a_scan: IdealScan) -> None:
    gain = beam_gain(SENSOR, 64)
    truth = report(a_scan, gain, sensor=SENSOR, spec=SPEC)
    r, t = a_scan.range_m.astype(np.float64), a_scan.incidence_rad.astype(np.float64)
    sheet = a_scan.retro & (t < SENSOR.retro_angle_rad)
    echo = np.where(sheet, SENSOR.retro_gain, a_scan.reflectance * np.cos(t) ** SENSOR.incidence_exponent)
    echo = echo * (1 - np.exp(-((r / SENSOR.overlap_m) ** 2))) * np.exp(-2 * SENSOR.extinction * r)
    falloff = (SENSOR.reference_m / r) ** SENSOR.falloff
    intensity = SENSOR.scale * gain[:, None] * echo * falloff + SENSOR.offset
    threshold = SENSOR.threshold_reflectance / SENSOR.threshold_m**2
    lost = np.where(a_scan.glass, SENSOR.glass_loss, np.where(a_scan.absorbing, SENSOR.paint_loss, 0))
    chance = (1 - lost) / (1 + (echo / r**2 / threshold) ** (-1 / SENSOR.threshold_spread))
    met = a_scan.valid & (r > SPEC.min_range_m) & (r < SPEC.max_range_m)
    np.testing.assert_allclose(truth.image.intensity, np.clip(intensity, 0, 0.99), atol=2e-5)
    np.testing.assert_allclose(truth.detection, np.where(met, chance, 0), atol=2e-5)
    np.testing.assert_array_equal(truth.image.valid, met)


def test_a_target_of_threshold_reflectance_is_seen_half_of_the_time(a_scan: IdealScan) -> None:
    ideal = replace(SENSOR, overlap_m=1e-3, extinction=0.0)
    plain = a_scan.replace(
        range_m=np.full(SHAPE, SENSOR.threshold_m, np.float32),
        incidence_rad=np.zeros(SHAPE, np.float32),
        reflectance=np.full(SHAPE, SENSOR.threshold_reflectance, np.float32),
        valid=np.ones(SHAPE, bool),
        **{name: np.zeros(SHAPE, bool) for name in ("glass", "retro", "absorbing")},
    )
    truth = report(plain, beam_gain(ideal, 64), sensor=ideal, spec=SPEC)
    np.testing.assert_allclose(truth.detection, 0.5, atol=1e-4)
    seen = measure(truth, jax.random.key(0), sensor=ideal, spec=SPEC)
    assert np.asarray(seen.valid).mean() == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("step_m", [0.03, 0.002, 3.0])
def test_ranges_of_any_step_are_its_multiples(a_scan: IdealScan, step_m: float) -> None:
    away = jnp.full(SHAPE, 90.0, jnp.float32)
    truth = Truth(PolarImage(away, away, jnp.ones(SHAPE, bool)), a_scan, jnp.ones(SHAPE, jnp.float32))
    exact = replace(SENSOR, range_noise_m=0.0)
    seen = measure(truth, jax.random.key(1), sensor=exact, spec=replace(SPEC, range_step_m=step_m))
    np.testing.assert_allclose(seen.range_m, 90.0, atol=1e-4)


def test_measurements_scatter_about_the_truth_and_lie_on_the_sensor_s_steps(a_scan: IdealScan) -> None:
    level = jnp.full(SHAPE, 0.4, jnp.float32)
    image = PolarImage(jnp.full(SHAPE, 20.0, jnp.float32), level, jnp.ones(SHAPE, bool))
    truth = Truth(image, a_scan, jnp.ones(SHAPE, jnp.float32))
    seen = measure(truth, jax.random.key(1), sensor=SENSOR, spec=SPEC)
    assert np.asarray(seen.valid).all()
    error = np.asarray(seen.intensity, np.float64) - 0.4
    assert error.mean() == pytest.approx(0.0, abs=0.002)
    expected = np.sqrt((0.4 * SENSOR.noise_relative) ** 2 + SENSOR.noise_floor**2 + 0.01**2 / 12)
    assert error.std() == pytest.approx(expected, rel=0.05)
    steps = np.asarray(seen.range_m, np.float64) / SPEC.range_step_m
    np.testing.assert_allclose(steps, np.round(steps), atol=0.01)
