"""The LiDAR of the embedded world, which networks are to learn and nobody tells them.

Letters: rho diffuse reflectance at 905 nm, t incidence angle, r range, b beam; P received power, I intensity.

    P = rho cos(t)^n O(r) exp(-2 alpha r) / r^2            what comes back
    I = scale g_b rho cos(t)^n O(r) (r0 / r)^p exp(-2 alpha r) + offset     what firmware reports
    Pr(return) = logistic(ln(P / P_th) / s), less what glass and black paint lose; P_th = rho_th / r_th^2

O(r) = 1 - exp(-(r / r_d)^2) is the receiver's near-range overlap; firmware undoes the inverse square but for a rest p.
Retroreflecting sheet saturates the report. Noise is multiplicative and additive; the report is cut to steps of
1/100 below 1, as KITTI stores it.

Sources: overlap and its r_d of some metres, Mukupa et al. 2017; exponent n below Lambert's 1 for rough matter, ibid.;
extinction by Koschmieder, ln 20 / visibility; per-laser gains and their spread, Levinson and Thrun, "Unsupervised
Calibration for Multi-beam Lasers", and KITTI's own scans, of whose lasers some are weaker than their neighbours by
a factor of three and more; detection as a logistic in
ln P with its middle at "a target of 10 % at 50 m", HDL-64E data sheet; retroreflection 10^2 and more above a white
target, tolerant to 40 degrees, HDL-32E and RoboSense manuals; loss on glass and black paint, orders of magnitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float

from jaxsim.data.synthetic.render import IdealScan
from jaxsim.frame import Array, PolarImage
from jaxsim.geometry import LidarSpec


@dataclass(frozen=True)
class TrueSensor:
    """Parameters of the sensor's physics and electronics."""

    scale: float = 1.25
    """Reported intensity of a white target, head on, at r0."""
    incidence_exponent: float = 0.45
    """n."""
    overlap_m: float = 3.0
    """r_d."""
    falloff: float = 0.25
    """p: what the firmware's range compensation leaves."""
    reference_m: float = 12.0
    """r0."""
    extinction: float = 5e-4
    """alpha, 1/m: visibility of 6 km."""
    gain_spread: float = 0.26
    """Standard deviation of ln g_b over the beams."""
    weak_share: float = 0.08
    """Share of the beams whose gain is far below the others'."""
    weak_gain: float = 0.35
    gain_seed: int = 7
    """The beams' gains belong to the sensor, not to a scene."""
    offset: float = -0.025
    threshold_reflectance: float = 0.10
    threshold_m: float = 50.0
    """A target of that reflectance, head on, is seen half of the time at that range."""
    threshold_spread: float = 0.35
    """s."""
    glass_loss: float = 0.75
    paint_loss: float = 0.35
    """Share of rays that black, absorbing paint swallows."""
    retro_angle_rad: float = 0.9
    """Sheeting works up to this incidence."""
    retro_gain: float = 300.0
    noise_relative: float = 0.08
    noise_floor: float = 0.014
    range_noise_m: float = 0.02


@struct.dataclass
class Truth:
    """What the sensor would report without noise and without loss, and what its rays meet."""

    image: PolarImage
    """Exact range; intensity before noise and rounding; valid where a ray meets something within reach."""
    scan: IdealScan
    detection: Float[Array, "rows columns"]
    """Probability that the beam comes back."""


def beam_gain(sensor: TrueSensor, rows: int) -> Float[np.ndarray, " rows"]:
    """g_b: the gain of every beam, the same in all scenes."""
    rng = np.random.default_rng([sensor.gain_seed, rows])
    gain = np.exp(rng.normal(0.0, sensor.gain_spread, rows))
    weak = rng.choice(rows, round(sensor.weak_share * rows), replace=False)
    gain[weak] *= sensor.weak_gain
    return (gain / gain.mean()).clip(0.15, 2.0).astype(np.float32)


@partial(jax.jit, static_argnames=("sensor", "spec"))
def report(scan: IdealScan, gain: Float[Array, " rows"], *, sensor: TrueSensor, spec: LidarSpec) -> Truth:
    """What the sensor would say of a sweep without noise."""
    r = jnp.clip(scan.range_m, 0.1, 2.0 * spec.max_range_m)
    retro = scan.retro & (scan.incidence_rad < sensor.retro_angle_rad)
    # Leaves and sheets are never met exactly edge on: a beam has a width.
    facing = jnp.maximum(jnp.cos(scan.incidence_rad), 0.01) ** sensor.incidence_exponent
    # rho cos(t)^n O(r) exp(-2 alpha r), of which P and I are made.
    echo = jnp.where(retro, sensor.retro_gain, scan.reflectance * facing)
    echo = echo * (1.0 - jnp.exp(-((r / sensor.overlap_m) ** 2))) * jnp.exp(-2 * sensor.extinction * r)
    intensity = sensor.scale * gain[:, None] * echo * (sensor.reference_m / r) ** sensor.falloff + sensor.offset
    # ln(P / P_th), with P = echo / r^2.
    threshold = sensor.threshold_reflectance / sensor.threshold_m**2
    margin = jnp.log(jnp.maximum(echo, 1e-9) / (r * r * threshold))
    lost = jnp.where(scan.glass, sensor.glass_loss, jnp.where(scan.absorbing, sensor.paint_loss, 0.0))
    met = scan.valid & (scan.range_m > spec.min_range_m) & (scan.range_m < spec.max_range_m)
    detection = jnp.where(met, (1.0 - lost) * jax.nn.sigmoid(margin / sensor.threshold_spread), 0.0)
    top = 1.0 - (spec.intensity_step or 0.0)
    return Truth(PolarImage(scan.range_m, jnp.clip(intensity, 0.0, top), met), scan, detection)


@partial(jax.jit, static_argnames=("sensor", "spec"))
def measure(truth: Truth, key: Array, *, sensor: TrueSensor, spec: LidarSpec) -> PolarImage:
    """One noisy measurement: which beams come back, with what range and intensity."""
    came, scaled, added, ranging = jax.random.split(key, 4)
    shape = truth.detection.shape
    valid: Bool[Array, "rows columns"] = jax.random.uniform(came, shape, jnp.float32) < truth.detection
    relative = 1.0 + sensor.noise_relative * jax.random.normal(scaled, shape, jnp.float32)
    floor = sensor.noise_floor * jax.random.normal(added, shape, jnp.float32)
    top = 1.0 - (spec.intensity_step or 0.0)
    # A saturated receiver reports its top step whatever the noise.
    noisy = jnp.where(truth.image.intensity < top, truth.image.intensity * relative + floor, top)
    intensity = _step(jnp.clip(noisy, 0.0, top), spec.intensity_step)
    noise = sensor.range_noise_m * jax.random.normal(ranging, shape, jnp.float32)
    range_m = _step(truth.image.range_m + noise, spec.range_step_m)
    valid = valid & (range_m > spec.min_range_m)
    return PolarImage(jnp.where(valid, range_m, 0.0), jnp.where(valid, intensity, 0.0), valid)


def _step(value: Float[Array, "rows columns"], step: float) -> Float[Array, "rows columns"]:
    """Nearest multiple of the step, written so that k/100 comes out as the float nearest to it."""
    if not step:
        return value
    steps, share = jnp.round(value / step), round(1.0 / step)
    return steps / jnp.float32(share) if abs(share * step - 1.0) < 1e-6 else steps * jnp.float32(step)
