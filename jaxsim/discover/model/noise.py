"""Noise that no effect explains: scales and rates, fitted with every effect, and the variances that follow from them.

Noise on the sensor's readings and noise in what the simulator knows of the street (normals, edges, silhouettes) have a
scale or a rate each, one for all frames. `likelihood` says where each enters.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.simulator import NORMAL
from jaxsim.effects.rays import Rays
from jaxsim.frame import Array

DEGREES = 4.0
"""Degrees of freedom of the Student-t of ln I and of the range: tails so heavy that no single ray decides."""
STEEPEST_NOISE_RAD = 1.4
"""Incidence beyond which noise on the normals counts no more: its tangent would be without bound."""


@struct.dataclass
class Noise:
    """Scales (natural logarithms) and rates (log odds) of what is not explained."""

    intensity: Float[Array, "*k"]
    """Scale of ln I."""
    normals: Float[Array, "*k"]
    """Standard deviation of the noise on the simulator's normals, rad: it makes ln I noisier as tan(incidence)."""
    range_: Float[Array, "*k"]
    """Scale of the range, m."""
    aim: Float[Array, "*k"]
    """Standard deviation of the angle by which a beam misses its direction, rad: it makes grazing and far surfaces
    noisy."""
    edge: Float[Array, "*k"]
    """Scale of the range at edges, m: which of two surfaces a ray meets there is not known so well."""
    wide: Float[Array, "*k"]
    """Rate of ranges far off, on smooth surfaces."""
    wide_edge: Float[Array, "*k"]
    """Rate of ranges far off, at edges."""
    switch_edge: Float[Array, "*k"]
    """Rate at which edges read a neighbour's range."""
    drop: Float[Array, "*k"]
    """Rate of rays lost, on smooth surfaces."""
    drop_edge: Float[Array, "*k"]
    """Rate of rays lost, at edges and depth steps."""
    drop_sky: Float[Array, "*k"]
    """Rate of rays lost beside rays that hit nothing, where a beam or two of a silhouette goes past it."""
    false: Float[Array, "*k"]
    """Rate of returns where the simulated ray hits nothing."""
    false_edge: Float[Array, "*k"]
    """Rate of returns where the simulated ray hits nothing, beside a surface."""


START = Noise(
    intensity=np.float32(-2.3),  # 10 %
    normals=np.float32(-4.0),  # 1 degree
    range_=np.float32(-4.0),  # 2 cm
    aim=np.float32(-8.0),  # 0.02 degrees
    edge=np.float32(-2.0),  # 14 cm
    wide=np.float32(-5.0),  # 0.7 %
    wide_edge=np.float32(-2.0),  # 12 %
    switch_edge=np.float32(-1.0),  # 27 %
    drop=np.float32(-5.0),  # 0.7 %
    drop_edge=np.float32(-3.0),  # 5 %, cut to MOST as fits begin
    drop_sky=np.float32(-2.0),  # 12 %
    false=np.float32(-6.0),  # 0.2 %
    false_edge=np.float32(-2.0),  # 12 %
)
"""Where the first fit begins."""
NOISE_SD = 2.0
"""Prior standard deviation of every logarithm of a scale and log odds of a rate about where its fit begins."""
MOST = {"drop": -5.0, "drop_edge": -3.9}
"""Upper bounds: what is lost more often than 0.7 % of rays (2 % at edges) is lost to an effect."""
LEAST = {"intensity": float(np.log(5e-3)), "edge": float(np.log(0.1)), "range_": float(np.log(1e-3))}
"""Lower bounds: no intensity is known to less than half a per cent: against a source without noise (CARLA's is
exp(-a r)) densities would have no end, and rounding be evidence of effects. A simulator's edges are not known to less
than 0.1 m, or single rays decide; and no range to less than the millimetre that files hold, or a simulation on the
measured ranges has densities without end, too."""


def intensity_variance(ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    """Squared scale of ln I, nats^2: of the sensor, of the angle by which the simulator's normals are off, through
    Lambert's law: d ln cos(a) = -tan(a) da, and what is known of both sides' noise."""
    steep = jnp.minimum(ev.given_rad, STEEPEST_NOISE_RAD)
    of_sensor = jnp.exp(2 * noise.intensity) + jnp.exp(2 * noise.normals) * jnp.tan(steep) ** 2
    return of_sensor + ev.known_variance


def range_variance(ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    """Squared scale of the range, m^2: of the sensor, of a beam's aim through the derivatives in the pose's rotations,
    and of edges."""
    aim = jnp.exp(2 * noise.aim) * jnp.sum(ev.pose[..., 3:] ** 2, axis=-1)
    of_sensor = jnp.exp(2 * noise.range_) + aim + jnp.where(ev.edge, jnp.exp(2 * noise.edge), 0)
    return of_sensor + ev.known_range_variance


def reading_variance(rays: Rays, ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    """`range_variance` with what effects that `rays` carry scatter, and with the lattice that they put readings on
    (uniform within a step: step^2 / 12)."""
    return range_variance(ev, noise) + (NORMAL * rays.noise_m) ** 2 + rays.range_step_m**2 / 12
