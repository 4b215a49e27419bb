"""What may differ between simulation and measurement without any missing effect, fitted first and always.

Noise scales and rates (`Noise`) are fitted with the effect; reflectances and poses follow from the residuals in
closed form: a class's and the whole gain from the scenes that are fitted; the levels of classes, objects, patches
and strips in one street, and a frame's pose, from their own frame. These last are random effects: what they take up
costs what their prior asks (the marginal likelihood of a normal model), or an effect that acts like a pose would be
free.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.discover.evidence import FIRM, POSE_SD, STREET_SD, STRIP_SD, Evidence
from jaxsim.frame import Array

CLASS_MOST = 0.7
"""A class's reflectance is off by a factor of 2 at most: what is brighter is no diffuse surface."""
POSE_MOST = 0.15
"""Of its range that a frame's pose moves a reading at most."""
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


@jax.jit
def weights(ev: Evidence, noise: Noise, off_i: Float[Array, "b c r"], off_r: Float[Array, "b c r"]) -> Weights:
    """Robust weights at the residuals `off_i` (nats) and `off_r` (m) of the null model."""
    variance = intensity_variance(ev, noise)
    w_i = jnp.where(ev.compared, 5 / (4 + off_i**2 / variance) / variance, 0.0)
    spread = range_variance(ev, noise)
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


def reflectance(
    ev: Evidence, w: Weights, fitted: Float[Array, " b"], residual: Float[Array, "b c r"]
) -> tuple[Float[Array, "b c r"], Float[Array, " b"]]:
    """What class, gain, curvature and surface explain of `residual`, nats (the first three from `fitted` blocks), and
    what the surfaces' share costs each block, nats of log-likelihood."""
    strips, surfaces, blocks = w.strips, w.surfaces, len(ev.unit)
    of_strip, of_surface, rhs = _sums(ev, w, residual)
    shared = _shared(ev, w, fitted, rhs)
    here = jnp.einsum("bpq,bq->bp", w.street, rhs - jnp.einsum("bpq,q->bp", w.gram, shared))
    levels = shared[None] + here
    surface = (of_surface - jnp.sum(surfaces.features * levels[surfaces.block], axis=-1)) * surfaces.share
    strip = of_strip - jnp.sum(strips.features * levels[strips.block], axis=-1)
    strip = (strip - strips.weight * surface[ev.surface]) * strips.share
    cost = 0.5 / STREET_SD**2 * jnp.sum(here**2, axis=-1)
    for group, own in ((strips, strip), (surfaces, surface)):
        cost = cost + jax.ops.segment_sum(0.5 * group.hold * own**2, group.block, blocks)
    level = (strip + surface[ev.surface])[ev.strip.reshape(-1)].reshape(residual.shape)
    explained = jnp.einsum("bcrp,bp->bcr", ev.features, levels) + level
    return jnp.where(ev.compared, explained, 0), cost


def _sums(ev: Evidence, w: Weights, residual: Float[Array, "b c r"]) -> tuple[Array, Array, Array]:
    """Weighted residuals of each strip and surface, and of each block's features with the former taken out."""
    strips, surfaces, blocks = w.strips, w.surfaces, len(ev.unit)
    weighted = jnp.where(ev.compared, residual, 0) * w.intensity
    of_strip = jax.ops.segment_sum(weighted.reshape(-1), ev.strip.reshape(-1), len(ev.surface))
    of_surface = jax.ops.segment_sum(of_strip * strips.hold * strips.share, ev.surface, len(ev.hold))
    rhs = jnp.einsum("bcrp,bcr->bp", ev.features, weighted)
    return of_strip, of_surface, rhs - strips.known(of_strip, blocks) - surfaces.known(of_surface, blocks)


def _shared(ev: Evidence, w: Weights, fitted: Float[Array, " b"], rhs: Float[Array, "b p"]) -> Float[Array, " p"]:
    """What the features count for in the `fitted` blocks together."""
    gram = w.gram - w.gram @ w.street @ w.gram
    shared = fitted @ (rhs - jnp.einsum("bpq,bqs,bs->bp", w.gram, w.street, rhs))
    shared = jnp.linalg.solve(jnp.einsum("b,bpq->pq", fitted, gram) + jnp.diag(ev.ridge), shared)
    classes = jnp.clip(shared[1:-OTHERS], -CLASS_MOST, CLASS_MOST)
    return jnp.concatenate([shared[:1], classes, shared[-OTHERS:]])


@jax.jit
def gain_and_classes(ev: Evidence, w: Weights, fitted: Float[Array, " b"]) -> Float[Array, " k"]:
    """ln of the overall gain, and of each class's reflectance over the simulator's, classes in order."""
    residual = ev.log_intensity - ev.rays.log_intensity
    return _shared(ev, w, fitted, _sums(ev, w, residual)[2])[:-OTHERS]


def pose_shift(
    ev: Evidence, w: Weights, predicted_m: Float[Array, "b c r"], on: Bool[Array, "b c r"]
) -> tuple[Float[Array, "b c r"], Float[Array, " b"]]:
    """By how much a small motion of each frame, fitted to the rays that are `on`, moves the predicted ranges, m, and
    its cost, nats of log-likelihood.

    1 / range is linear in the motion on planes, also far away on the road, where the range is not.
    """
    measured = jnp.where(on, ev.range_m, predicted_m)
    residual = (measured - predicted_m) * predicted_m / jnp.maximum(measured, 0.1)
    rhs = jnp.einsum("bcri,bcr->bi", ev.pose, residual * w.range_)
    pose = jnp.einsum("bij,bj->bi", w.pose, rhs)
    cost = 0.5 * jnp.sum((pose / jnp.asarray(POSE_SD, jnp.float32)[None]) ** 2, axis=-1)
    away = jnp.einsum("bcri,bi->bcr", ev.pose, pose) / jnp.maximum(predicted_m, 0.1)
    away = jnp.clip(away, -POSE_MOST, POSE_MOST)
    return predicted_m * away / (1 - away), cost
