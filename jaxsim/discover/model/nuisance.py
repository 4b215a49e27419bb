"""What may differ between simulation and measurement without any missing effect, fitted first and always.

Noise scales and rates (`Noise`) are fitted with the effect; reflectances and poses follow from the residuals in
closed form (`random_effects`): a class's and the whole gain from the scenes that are fitted; the levels of classes,
objects, patches and strips in one street, and a frame's pose, from their own frame. These last are random effects:
what they take up costs what their prior asks (the marginal likelihood of a normal model), or an effect that acts like
a pose would be free.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Float, Int

from jaxsim.discover.model.evidence import POSE_SD, Evidence
from jaxsim.discover.model.surfaces import FIRM, STREET_SD, STRIP_SD
from jaxsim.effects.rays import Rays
from jaxsim.frame import Array

POSE_MOST = 0.15
"""Of its range that a frame's pose moves a reading at most."""
NORMAL = 0.86
"""Scale that normal noise of standard deviation 1 adds, in squares, to a Student-t of 4 degrees that is fitted to the
sum: 0.89 where the noise is weak, 0.83 where it is all."""
OTHERS = 4
"""Features behind the classes: curvature and the three of disagreeing normals."""


@struct.dataclass
class Noise:
    """Scales (natural logarithms) and rates (log odds) of what is not explained."""

    intensity: Float[Array, "*k"]
    """Of the scale of ln I."""
    normals: Float[Array, "*k"]
    """Of the noise on the simulator's normals, rad: it makes ln I noisier as tan(incidence)."""
    range_: Float[Array, "*k"]
    """Of the scale of the range, m."""
    aim: Float[Array, "*k"]
    """Of the angle by which a beam misses its direction, rad: it makes grazing and far surfaces noisy."""
    edge: Float[Array, "*k"]
    """Of the scale of the range at edges, m: which of two surfaces a ray meets there is not known so well."""
    wide: Float[Array, "*k"]
    """Ranges far off, on smooth surfaces."""
    wide_edge: Float[Array, "*k"]
    switch_edge: Float[Array, "*k"]
    """Edges where a neighbour's range is read."""
    drop: Float[Array, "*k"]
    drop_edge: Float[Array, "*k"]
    drop_sky: Float[Array, "*k"]
    """Beside rays that hit nothing, where a beam or two of a silhouette goes past it."""
    false: Float[Array, "*k"]
    """Returns where the simulated ray hits nothing."""
    false_edge: Float[Array, "*k"]


MOST = {"drop": -5.0, "drop_edge": -3.9}
"""Upper bounds: what is lost more often than 0.7 % of rays (2 % at edges) is lost to an effect."""
LEAST = {"edge": float(np.log(0.1)), "range_": float(np.log(1e-3))}
"""Lower bounds: a simulator's edges are not known to less than 0.1 m, or single rays decide; and no range to less than
the millimetre that files hold, or a simulation on the measured ranges has densities without end."""
START = Noise(*(np.float32(v) for v in (-2.3, -4.0, -4.0, -8.0, -2.0, -5.0, -2.0, -1.0, -5.0, -3.0, -2.0, -6.0, -2.0)))


@struct.dataclass
class Group:
    """Rays that share a reflectance of their own, g groups."""

    weight: Float[Array, " g"]
    features: Float[Array, "g p"]
    hold: Float[Array, " g"]
    block: Int[Array, " g"]
    """In which each lies."""

    @property
    def share(self) -> Float[Array, " g"]:
        return 1 / (self.weight + self.hold)

    def taken(self, blocks: int) -> Float[Array, "b p p"]:
        """What the groups take out of each block's Gram matrix."""
        outer = jnp.einsum("sp,sq->spq", self.features, self.features * self.share[:, None])
        return jax.ops.segment_sum(outer, self.block, blocks)

    def known(self, total: Float[Array, " g"], blocks: int) -> Float[Array, "b p"]:
        """What the groups take out of each block's right side, of the groups' weighted sums `total`."""
        return jax.ops.segment_sum(self.features * (total * self.share)[:, None], self.block, blocks)


@struct.dataclass
class Weights:
    """Of the rays in the closed forms, from the null fit, and what follows from them."""

    intensity: Float[Array, "b c r"]
    range_: Float[Array, "b c r"]
    strips: Group
    surfaces: Group
    gram: Float[Array, "b p p"]
    """Of the features in each block, strips' and surfaces' own reflectances taken out."""
    street: Float[Array, "b p p"]
    """Covariance of a block's own levels of the classes; 0 for the other features."""
    pose: Float[Array, "b 6 6"]
    """Covariance of a block's pose."""


def intensity_variance(ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    steep = jnp.minimum(ev.given_rad, 1.4)
    return jnp.exp(2 * noise.intensity) + jnp.exp(2 * noise.normals) * jnp.tan(steep) ** 2


def range_variance(ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    aim = jnp.exp(2 * noise.aim) * jnp.sum(ev.pose[..., 3:] ** 2, axis=-1)
    return jnp.exp(2 * noise.range_) + aim + jnp.where(ev.edge, jnp.exp(2 * noise.edge), 0)


def reading_variance(rays: Rays, ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    """`range_variance` with what effects that `rays` carry scatter, and with the lattice that they put readings on."""
    return range_variance(ev, noise) + (NORMAL * rays.noise_m) ** 2 + rays.range_step_m**2 / 12


@jax.jit
def weights(ev: Evidence, noise: Noise, off_i: Float[Array, "b c r"], off_r: Float[Array, "b c r"]) -> Weights:
    """Robust weights at the residuals `off_i` (nats) and `off_r` (m) of the null model."""
    variance = intensity_variance(ev, noise)
    w_i = jnp.where(ev.compared, 5 / (4 + off_i**2 / variance) / variance, 0.0)
    spread = reading_variance(ev.rays, ev, noise)
    smooth = ev.rays.hit & ev.returned & ~ev.edge & (jnp.abs(off_r) < jnp.maximum(0.3, POSE_MOST * ev.rays.range_m))
    w_r = jnp.where(smooth, 5 / (4 + off_r**2 / spread) / spread, 0.0)
    weighted = ev.features * w_i[..., None]
    features = weighted.reshape(-1, weighted.shape[-1])
    at = jnp.broadcast_to(jnp.arange(len(ev.unit))[:, None, None], ev.strip.shape).reshape(-1)
    strip, count = ev.strip.reshape(-1), len(ev.surface)
    own = jnp.where(ev.surface > 0, 1 / STRIP_SD**2, FIRM)
    block = jnp.maximum(jax.ops.segment_max(at, strip, count), 0)
    weight, features = (jax.ops.segment_sum(x, strip, count) for x in (w_i.reshape(-1), features))
    strips = Group(weight, features, own, block)
    # What a strip says of its surface.
    left = own * strips.share
    each = (weight * left, features * left[:, None])
    weight, features = (jax.ops.segment_sum(x, ev.surface, len(ev.hold)) for x in each)
    block = jnp.maximum(jax.ops.segment_max(block, ev.surface, len(ev.hold)), 0)
    surfaces = Group(weight, features, ev.hold, block)
    gram = jnp.einsum("bcrp,bcrq->bpq", weighted, ev.features)
    gram = gram - strips.taken(len(ev.unit)) - surfaces.taken(len(ev.unit))
    kinds = jnp.arange(gram.shape[-1])
    ours = ((kinds > 0) & (kinds < gram.shape[-1] - OTHERS)).astype(gram.dtype)
    kept = jnp.outer(ours, ours)[None]
    free = jnp.diag(jnp.where(ours > 0, 1 / STREET_SD**2, 1.0))
    street = jnp.linalg.inv(gram * kept + free[None]) * kept
    prior = jnp.diag(jnp.asarray(1 / POSE_SD**2, jnp.float32))
    information = jnp.einsum("bcri,bcrj,bcr->bij", ev.pose, ev.pose, w_r) + prior[None]
    return Weights(w_i, w_r, strips, surfaces, gram, street, jnp.linalg.inv(information))
