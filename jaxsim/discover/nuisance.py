"""What may differ between simulation and measurement without any missing effect, fitted first and always.

Noise scales and rates (`Noise`) are fitted with the effect; reflectances and poses follow from the residuals in
closed form: a class's and the whole gain from the scenes that are fitted, an object's reflectance and a frame's
pose from their own frame (random effects).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Float

from jaxsim.discover.evidence import POSE_SD, Evidence
from jaxsim.frame import Array

INSTANCE_SD = 0.2
"""Of an object's reflectance about its class, nats."""
CLASS_MOST = 0.7
"""A class's reflectance is off by a factor of 2 at most: what is brighter is no diffuse surface."""
POSE_MOST_M = 0.5
OTHERS = 3
"""Features behind the classes: curvature and the two of disagreeing normals."""


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
    wide: Float[Array, "*k"]
    """Ranges far off, on smooth surfaces."""
    wide_edge: Float[Array, "*k"]
    switch_edge: Float[Array, "*k"]
    """Edges where a neighbour's range is read."""
    drop: Float[Array, "*k"]
    drop_edge: Float[Array, "*k"]
    false: Float[Array, "*k"]
    """Returns where the simulated ray hits nothing."""
    false_edge: Float[Array, "*k"]


MOST = {"drop": -5.0, "drop_edge": -3.9}
"""Upper bounds: what is lost more often than 0.7 % of rays (2 % at edges) is lost to an effect."""
START = Noise(*(jnp.float32(v) for v in (-2.3, -4.0, -4.0, -8.0, -5.0, -2.0, -1.0, -5.0, -3.0, -6.0, -2.0)))


@struct.dataclass
class Weights:
    """Of the rays in the closed forms, from the null fit, and what follows from them."""

    intensity: Float[Array, "b c r"]
    range_: Float[Array, "b c r"]
    by_instance: Float[Array, " s"]
    features_by_instance: Float[Array, "s p"]
    gram: Float[Array, "b p p"]
    """Of the features in each block, objects' own reflectances taken out."""
    pose: Float[Array, "b 6 6"]
    """Covariance of a block's pose."""


def intensity_variance(ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    steep = jnp.minimum(ev.rays.incidence_rad, 1.4)
    return jnp.exp(2 * noise.intensity) + jnp.exp(2 * noise.normals) * jnp.tan(steep) ** 2


def range_variance(ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    return jnp.exp(2 * noise.range_) + jnp.exp(2 * noise.aim) * jnp.sum(ev.pose[..., 3:] ** 2, axis=-1)


@jax.jit
def weights(ev: Evidence, noise: Noise, off_i: Float[Array, "b c r"], off_r: Float[Array, "b c r"]) -> Weights:
    """Robust weights at the residuals `off_i` (nats) and `off_r` (m) of the null model."""
    variance = intensity_variance(ev, noise)
    w_i = jnp.where(ev.compared, 5 / (4 + off_i**2 / variance) / variance, 0.0)
    spread = range_variance(ev, noise)
    smooth = ev.rays.hit & ev.returned & ~ev.edge & (jnp.abs(off_r) < POSE_MOST_M)
    w_r = jnp.where(smooth, 5 / (4 + off_r**2 / spread) / spread, 0.0)
    flat, segment = w_i.reshape(-1), ev.instance.reshape(-1)
    own = segment > 0
    weighted = ev.features * w_i[..., None]
    by_instance = jax.ops.segment_sum(jnp.where(own, flat, 0), segment, ev.instances)
    features = jax.ops.segment_sum(jnp.where(own[:, None], weighted.reshape(len(flat), -1), 0), segment, ev.instances)
    gram = jnp.einsum("bcrp,bcrq->bpq", weighted, ev.features)
    # An instance lies in one block: take out of that block's Gram matrix what its own reflectance takes.
    block = jax.ops.segment_max(
        jnp.broadcast_to(jnp.arange(len(ev.unit))[:, None, None], ev.instance.shape).reshape(-1),
        segment,
        ev.instances,
    )
    shrunk = features / (by_instance + 1 / INSTANCE_SD**2)[:, None]
    outer = jnp.einsum("sp,sq->spq", features, shrunk)
    gram = gram - jax.ops.segment_sum(outer, jnp.maximum(block, 0), len(ev.unit))
    prior = jnp.diag(jnp.asarray(1 / POSE_SD**2, jnp.float32))
    information = jnp.einsum("bcri,bcrj,bcr->bij", ev.pose, ev.pose, w_r) + prior[None]
    return Weights(w_i, w_r, by_instance, features, gram, jnp.linalg.inv(information))


def reflectance(
    ev: Evidence, w: Weights, fitted: Float[Array, " b"], residual: Float[Array, "b c r"]
) -> Float[Array, "b c r"]:
    """What class, gain, curvature and object explain of `residual`, nats; the first three from `fitted` blocks."""
    weighted = jnp.where(ev.compared, residual, 0) * w.intensity
    flat, segment = weighted.reshape(-1), ev.instance.reshape(-1)
    by_instance = jax.ops.segment_sum(flat, segment, ev.instances)
    strength = 1 / (w.by_instance + 1 / INSTANCE_SD**2)
    taken = ((by_instance * strength)[segment]).reshape(residual.shape)
    own = ev.instance > 0
    rhs = jnp.einsum("bcrp,bcr->bp", ev.features, weighted - jnp.where(own, taken * w.intensity, 0))
    gram = jnp.einsum("b,bpq->pq", fitted, w.gram) + jnp.diag(ev.ridge)
    shared = jnp.linalg.solve(gram, fitted @ rhs)
    classes = jnp.clip(shared[1:-OTHERS], -CLASS_MOST, CLASS_MOST)
    shared = jnp.concatenate([shared[:1], classes, shared[-OTHERS:]])
    left = (by_instance - w.features_by_instance @ shared) * strength
    return ev.features @ shared + jnp.where(own & ev.compared, left[segment].reshape(residual.shape), 0)


def pose_shift(ev: Evidence, w: Weights, residual: Float[Array, "b c r"]) -> Float[Array, "b c r"]:
    """What a small motion of each frame explains of a range residual, m."""
    rhs = jnp.einsum("bcri,bcr->bi", ev.pose, jnp.where(w.range_ > 0, residual, 0) * w.range_)
    return jnp.clip(jnp.einsum("bcri,bij,bj->bcr", ev.pose, w.pose, rhs), -POSE_MOST_M, POSE_MOST_M)
