"""What streets, surfaces and frames have of their own: levels of reflectance and poses, in closed form.

Random effects (Laird & Ware 1982): a level or a pose follows from the residuals of its own frame and from its prior,
and costs what the prior asks. What scenes share (gain, classes, curvature) follows from a fit's blocks (`in_fit` 1).

ln I of ray i in block b, over the simulator's, is a normal mixed model with a weight w_i a ray:

    residual_i = x_i (shared + street_b) + surface_s(i) + strip_t(i) + noise_i,   noise_i ~ N(0, 1 / w_i)

Strips and surfaces are taken out of the normal equations one level after the other (Schur complements, each a scalar),
streets by a small inverse a block; what is left is one system of p equations for the shared coefficients.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.cast import FIRM, STREET_SD, STRIP_SD
from jaxsim.discover.model.evidence import POSE_SD, Evidence
from jaxsim.discover.model.noise import DEGREES, Noise, intensity_variance, reading_variance
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import LEAST_M
from jaxsim.frame import Array
from jaxsim.products import einsum, inverse, matmul

CLASS_MOST = 0.7
"""A class's reflectance is off by a factor of 2 at most: what is brighter is no diffuse surface."""
POSE_MOST = 0.15
"""Share of its range by which a frame's pose moves a reading at most."""


@struct.dataclass
class Groups:
    """Rays that share a level of their own (strips, or surfaces), g groups."""

    weight: Float[Array, " g"]
    """Sum of the rays' weights, 1/nats^2, and of their weighted features."""
    features: Float[Array, "g p"]
    precision: Float[Array, " g"]
    """1 / prior variance of the level."""
    block: Int[Array, " g"]
    """The block in which each group lies."""

    @property
    def variance(self) -> Float[Array, " g"]:
        """The variance of each level, given its rays."""
        return 1 / (self.weight + self.precision)

    def gram_of_levels(self, blocks: int) -> Float[Array, "{blocks} p p"]:
        """What the levels take out of each block's Gram matrix."""
        # Schur complement of a scalar: f f' / (weight + precision).
        outer = einsum("sp,sq->spq", self.features, self.features * self.variance[:, None])
        return jax.ops.segment_sum(outer, self.block, blocks)

    def sums_of_levels(self, total: Float[Array, " g"], blocks: int) -> Float[Array, "{blocks} p"]:
        """What the levels take out of each block's right side, of the groups' weighted sums `total`."""
        return jax.ops.segment_sum(self.features * (total * self.variance)[:, None], self.block, blocks)


@struct.dataclass
class NormalEquations:
    """Robust weights of the rays at a null fit's residuals, and what follows from them alone."""

    intensity: Float[Array, "b c r"]
    """Weights of ln I, 1/nats^2; 0 where it is not compared."""
    range_: Float[Array, "b c r"]
    """Weights of the range, 1/m^2; 0 where it is not compared."""
    strips: Groups
    surfaces: Groups
    gram: Float[Array, "b p p"]
    """Products of the features in each block, strips' and surfaces' own levels taken out."""
    street: Float[Array, "b p p"]
    """Covariance of a block's own levels of the classes; 0 for the other features."""
    pose: Float[Array, "b 6 6"]
    """Covariance of a block's pose."""


def of_own_surface(off_m: Float[Array, "b c r"], range_m: Float[Array, "b c r"]) -> Bool[Array, "b c r"]:
    """Whether a reading so far off is of the ray's surface still, moved by a pose, and not of another."""
    return jnp.abs(off_m) < jnp.maximum(RULES.other_surface_m, POSE_MOST * range_m)


@jax.jit
def normal_equations(
    ev: Evidence, noise: Noise, off: tuple[Float[Array, "b c r"], Float[Array, "b c r"]]
) -> NormalEquations:
    """The equations at the null model's residuals `off`, of ln I in nats and of the range in m."""
    residual_i, residual_r = off
    # A Student-t is a normal whose precision follows a gamma law: (DEGREES + 1) / (DEGREES + z^2) is its expectation.
    # Weights of the normal that touches each ray's Student-t at its residual: what lies far off weighs little.
    variance = intensity_variance(ev, noise)
    weight_i = jnp.where(ev.compared, (DEGREES + 1) / (DEGREES + residual_i**2 / variance) / variance, 0.0)
    spread = reading_variance(ev.rays, ev, noise)
    # A reading of another surface tells nothing of the pose.
    weight_r = jnp.where(
        ev.smooth & of_own_surface(residual_r, ev.rays.range_m),
        (DEGREES + 1) / (DEGREES + residual_r**2 / spread) / spread,
        0.0,
    )
    weighted = ev.features * weight_i[..., None]
    strips = _strips(ev, weight_i, weighted)
    surfaces = _surfaces(ev, strips)
    # Of X'WX of the features, what strips and surfaces take up by levels of their own.
    gram = einsum("bcrp,bcrq->bpq", weighted, ev.features)
    gram = gram - strips.gram_of_levels(len(ev.scene)) - surfaces.gram_of_levels(len(ev.scene))
    # Only classes have a level in each street: gain and angles are the sensor's and the simulator's everywhere.
    kinds = jnp.arange(gram.shape[-1])
    classes = ((kinds > 0) & (kinds < gram.shape[-1] - ev.after_kinds)).astype(gram.dtype)
    mask = jnp.outer(classes, classes)[None]
    prior = jnp.diag(jnp.where(classes > 0, 1 / STREET_SD**2, 1.0))
    street = inverse(gram * mask + prior[None]) * mask
    # A pose is a small normal problem of its own in each block: six numbers, held by their prior.
    prior = jnp.diag(jnp.asarray(1 / POSE_SD**2, jnp.float32))
    information = einsum("bcri,bcrj,bcr->bij", ev.pose, ev.pose, weight_r) + prior[None]
    return NormalEquations(weight_i, weight_r, strips, surfaces, gram, street, inverse(information))


def _strips(ev: Evidence, weight: Float[Array, "b c r"], weighted: Float[Array, "b c r p"]) -> Groups:
    """The rays of each strip together."""
    features = weighted.reshape(-1, weighted.shape[-1])
    strip, count = ev.strip.reshape(-1), len(ev.surface)
    block = jnp.broadcast_to(jnp.arange(len(ev.scene))[:, None, None], ev.strip.shape).reshape(-1)
    return Groups(
        weight=jax.ops.segment_sum(weight.reshape(-1), strip, count),
        features=jax.ops.segment_sum(features, strip, count),
        precision=jnp.where(ev.surface > 0, 1 / STRIP_SD**2, FIRM),
        block=jnp.maximum(jax.ops.segment_max(block, strip, count), 0),
    )


def _surfaces(ev: Evidence, strips: Groups) -> Groups:
    """The strips of each surface together: each counts for what its own level leaves of its rays."""
    unshared = strips.precision * strips.variance
    count = len(ev.precision)
    return Groups(
        weight=jax.ops.segment_sum(strips.weight * unshared, ev.surface, count),
        features=jax.ops.segment_sum(strips.features * unshared[:, None], ev.surface, count),
        precision=ev.precision,
        block=jnp.maximum(jax.ops.segment_max(strips.block, ev.surface, count), 0),
    )


@struct.dataclass
class ReflectanceLevels:
    """Levels of reflectance over the simulator's, nats."""

    shared: Float[Array, " p"]
    """Coefficient of each feature, in all scenes."""
    street: Float[Array, "b p"]
    """Level of each class in one block, over `shared`."""
    features: Float[Array, "b p"]
    """Level of each feature in one block, both together."""
    surface: Float[Array, " s"]
    """Level of each surface, over its class in the street."""
    strip: Float[Array, " t"]
    """Level of the part of a surface that one column sees, over the surface."""


def reflectance(
    ev: Evidence, eq: NormalEquations, in_fit: Float[Array, " b"], *, residual: Float[Array, "b c r"]
) -> tuple[Float[Array, "b c r"], Float[Array, " b"]]:
    """What class, gain, curvature and surface explain of `residual`, nats (the first three from `in_fit` blocks), and
    what the streets' and surfaces' levels cost each block by their priors, nats of log-likelihood."""
    levels = levels_of(ev, eq, in_fit, residual=residual)
    cost = 0.5 / STREET_SD**2 * jnp.sum(levels.street**2, axis=-1)
    for groups, level in ((eq.strips, levels.strip), (eq.surfaces, levels.surface)):
        cost = cost + jax.ops.segment_sum(0.5 * groups.precision * level**2, groups.block, len(ev.scene))
    return jnp.where(ev.compared, explained_by(ev, levels), 0), cost


def levels_of(
    ev: Evidence, eq: NormalEquations, in_fit: Float[Array, " b"], *, residual: Float[Array, "b c r"]
) -> ReflectanceLevels:
    """The levels that fit `residual` (nats) best, given their priors; shared ones from the `in_fit` blocks."""
    strips, surfaces = eq.strips, eq.surfaces
    of_strip, of_surface, right = _sums(ev, eq, residual)
    shared = _shared(ev, eq, in_fit, right=right)
    # Back substitution: street, then surface, then strip, each of what the ones before leave.
    street = einsum("bpq,bq->bp", eq.street, right - einsum("bpq,q->bp", eq.gram, shared))
    features = shared[None] + street
    surface = (of_surface - jnp.sum(surfaces.features * features[surfaces.block], axis=-1)) * surfaces.variance
    strip = of_strip - jnp.sum(strips.features * features[strips.block], axis=-1)
    strip = (strip - strips.weight * surface[ev.surface]) * strips.variance
    return ReflectanceLevels(shared, street, features, surface, strip)


def explained_by(ev: Evidence, levels: ReflectanceLevels) -> Float[Array, "b c r"]:
    """Nats by which levels make each compared ray brighter than simulated."""
    of_ray = (levels.strip + levels.surface[ev.surface])[ev.strip.reshape(-1)].reshape(ev.strip.shape)
    return einsum("bcrp,bp->bcr", ev.features, levels.features) + of_ray


def _sums(
    ev: Evidence, eq: NormalEquations, residual: Float[Array, "b c r"]
) -> tuple[Float[Array, " t"], Float[Array, " s"], Float[Array, "b p"]]:
    """Weighted residuals of each strip and surface, and of each block's features with the former taken out."""
    strips = eq.strips
    surfaces = eq.surfaces
    blocks = len(ev.scene)
    weighted = jnp.where(ev.compared, residual, 0) * eq.intensity
    of_strip = jax.ops.segment_sum(weighted.reshape(-1), ev.strip.reshape(-1), len(ev.surface))
    # Of each strip's sum the share that its own level does not take up.
    of_surface = jax.ops.segment_sum(of_strip * strips.precision * strips.variance, ev.surface, len(ev.precision))
    # X'W residual, with what the levels take up left out, as in the matrix.
    right = einsum("bcrp,bcr->bp", ev.features, weighted)
    right = right - strips.sums_of_levels(of_strip, blocks) - surfaces.sums_of_levels(of_surface, blocks)
    return of_strip, of_surface, right


def _shared(
    ev: Evidence, eq: NormalEquations, in_fit: Float[Array, " b"], *, right: Float[Array, "b p"]
) -> Float[Array, " p"]:
    """Coefficients of the features in the `in_fit` blocks together, streets' levels taken out."""
    # A Schur complement again: what a street's own level would explain says nothing of the shared one.
    gram = eq.gram - matmul(matmul(eq.gram, eq.street), eq.gram)
    shared = matmul(in_fit, right - einsum("bpq,bqs,bs->bp", eq.gram, eq.street, right))
    shared = jnp.linalg.solve(einsum("b,bpq->pq", in_fit, gram) + jnp.diag(ev.ridge), shared)
    # Gain and angles are free; only classes are held.
    classes = jnp.clip(shared[1 : -ev.after_kinds], -CLASS_MOST, CLASS_MOST)
    return jnp.concatenate([shared[:1], classes, shared[-ev.after_kinds :]])


@jax.jit
def shared_levels(ev: Evidence, eq: NormalEquations, in_fit: Float[Array, " b"]) -> Float[Array, " p"]:
    """Coefficient of each feature in the `in_fit` blocks together: first ln of the overall gain, then ln of each kind's
    reflectance over the simulator's."""
    residual = ev.log_intensity - ev.rays.log_intensity
    _, _, right = _sums(ev, eq, residual)
    return _shared(ev, eq, in_fit, right=right)


def frame_poses(
    ev: Evidence, eq: NormalEquations, predicted_m: Float[Array, "b c r"], *, on: Bool[Array, "b c r"]
) -> Float[Array, "b 6"]:
    """The small motion of each frame that fits the rays that are `on` best: m along x, y, z and rad about them.

    1 / range is linear in the motion on planes, also far away on the road, where the range is not.
    """
    measured = jnp.where(on, ev.range_m, predicted_m)
    # r0^2 (1 / r0 - 1 / r) = (r - r0) r0 / r: the change of 1 / range, in metres at the predicted range r0.
    residual = (measured - predicted_m) * predicted_m / jnp.maximum(measured, LEAST_M)
    return einsum("bij,bj->bi", eq.pose, einsum("bcri,bcr->bi", ev.pose, residual * eq.range_))


def moved_by(ev: Evidence, pose: Float[Array, "b 6"], predicted_m: Float[Array, "b c r"]) -> Float[Array, "b c r"]:
    """How far a small motion of each frame moves the predicted ranges, m."""
    away = einsum("bcri,bi->bcr", ev.pose, pose) / jnp.maximum(predicted_m, LEAST_M)
    # A grazing ray far away would move without bound, or pass through infinity.
    away = jnp.clip(away, -POSE_MOST, POSE_MOST)
    return predicted_m * away / (1 - away)


def pose_shift(
    ev: Evidence, eq: NormalEquations, predicted_m: Float[Array, "b c r"], *, on: Bool[Array, "b c r"]
) -> tuple[Float[Array, "b c r"], Float[Array, " b"]]:
    """How far each frame's own pose (`frame_poses`) moves the predicted ranges, m, and what it costs by its prior, nats
    of log-likelihood."""
    pose = frame_poses(ev, eq, predicted_m, on=on)
    cost = 0.5 * jnp.sum((pose / jnp.asarray(POSE_SD, jnp.float32)[None]) ** 2, axis=-1)
    return moved_by(ev, pose, predicted_m), cost


@jax.jit
def conditional_residuals(
    ev: Evidence, eq: NormalEquations, in_fit: Float[Array, " b"]
) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"]]:
    """Residuals of ln I (nats) and of the range (m) given the levels and poses that fit them best; 0 where they are
    not compared. (Of a mixed model, residuals less fixed and random effects.)"""
    residual_i = jnp.where(ev.compared, ev.log_intensity - ev.rays.log_intensity, 0)
    residual_i = residual_i - reflectance(ev, eq, in_fit, residual=residual_i)[0]
    residual_r = jnp.where(ev.smooth, ev.range_m - ev.rays.reading_m, 0)
    shift, _ = pose_shift(ev, eq, ev.rays.reading_m, on=ev.smooth)
    return residual_i, jnp.where(ev.smooth, residual_r - shift, 0)
