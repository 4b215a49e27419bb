"""What streets, surfaces and frames have of their own: levels of reflectance and poses, in closed form.

Random effects (Laird & Ware 1982): a level or a pose follows from the residuals of its own frame and from its prior,
and costs what the prior asks. What scenes share (gain, classes, curvature) follows from the fitted scenes.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float

from jaxsim.discover.model.evidence import POSE_SD, Evidence
from jaxsim.discover.model.nuisance import OTHERS, POSE_MOST, Weights
from jaxsim.discover.model.surfaces import STREET_SD
from jaxsim.frame import Array

CLASS_MOST = 0.7
"""A class's reflectance is off by a factor of 2 at most: what is brighter is no diffuse surface."""


@struct.dataclass
class Levels:
    """Of reflectance over the simulator's, nats."""

    shared: Float[Array, " p"]
    """Of each feature, in all scenes."""
    street: Float[Array, "b p"]
    """Of each class in one block, over `shared`."""
    features: Float[Array, "b p"]
    """Of each feature in one block, both together."""
    surface: Float[Array, " s"]
    """Of each surface, over its class in the street."""
    strip: Float[Array, " t"]
    """Of the part of a surface that one column sees, over the surface."""


def reflectance(
    ev: Evidence, w: Weights, fitted: Float[Array, " b"], residual: Float[Array, "b c r"]
) -> tuple[Float[Array, "b c r"], Float[Array, " b"]]:
    """What class, gain, curvature and surface explain of `residual`, nats (the first three from `fitted` blocks), and
    what the surfaces' share costs each block, nats of log-likelihood."""
    levels = levels_of(ev, w, fitted, residual)
    cost = 0.5 / STREET_SD**2 * jnp.sum(levels.street**2, axis=-1)
    for group, own in ((w.strips, levels.strip), (w.surfaces, levels.surface)):
        cost = cost + jax.ops.segment_sum(0.5 * group.hold * own**2, group.block, len(ev.unit))
    return jnp.where(ev.compared, explained_by(ev, levels), 0), cost


def levels_of(ev: Evidence, w: Weights, fitted: Float[Array, " b"], residual: Float[Array, "b c r"]) -> Levels:
    """The levels that fit `residual` (nats) best, given their priors."""
    strips, surfaces = w.strips, w.surfaces
    of_strip, of_surface, rhs = _sums(ev, w, residual)
    shared = _shared(ev, w, fitted, rhs)
    here = jnp.einsum("bpq,bq->bp", w.street, rhs - jnp.einsum("bpq,q->bp", w.gram, shared))
    levels = shared[None] + here
    surface = (of_surface - jnp.sum(surfaces.features * levels[surfaces.block], axis=-1)) * surfaces.share
    strip = of_strip - jnp.sum(strips.features * levels[strips.block], axis=-1)
    strip = (strip - strips.weight * surface[ev.surface]) * strips.share
    return Levels(shared, here, levels, surface, strip)


def explained_by(ev: Evidence, levels: Levels) -> Float[Array, "b c r"]:
    """Nats by which levels make each compared ray brighter than simulated."""
    own = (levels.strip + levels.surface[ev.surface])[ev.strip.reshape(-1)].reshape(ev.strip.shape)
    return jnp.einsum("bcrp,bp->bcr", ev.features, levels.features) + own


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


def poses(
    ev: Evidence, w: Weights, predicted_m: Float[Array, "b c r"], on: Bool[Array, "b c r"]
) -> Float[Array, "b 6"]:
    """The small motion of each frame that fits the rays that are `on` best: m along x, y, z and rad about them.

    1 / range is linear in the motion on planes, also far away on the road, where the range is not.
    """
    measured = jnp.where(on, ev.range_m, predicted_m)
    residual = (measured - predicted_m) * predicted_m / jnp.maximum(measured, 0.1)
    return jnp.einsum("bij,bj->bi", w.pose, jnp.einsum("bcri,bcr->bi", ev.pose, residual * w.range_))


def moved_by(ev: Evidence, pose: Float[Array, "b 6"], predicted_m: Float[Array, "b c r"]) -> Float[Array, "b c r"]:
    """By how much a small motion of each frame moves the predicted ranges, m."""
    away = jnp.einsum("bcri,bi->bcr", ev.pose, pose) / jnp.maximum(predicted_m, 0.1)
    away = jnp.clip(away, -POSE_MOST, POSE_MOST)
    return predicted_m * away / (1 - away)


def pose_shift(
    ev: Evidence, w: Weights, predicted_m: Float[Array, "b c r"], on: Bool[Array, "b c r"]
) -> tuple[Float[Array, "b c r"], Float[Array, " b"]]:
    """By how much each frame's own pose (`poses`) moves the predicted ranges, m, and its cost, nats of
    log-likelihood."""
    pose = poses(ev, w, predicted_m, on)
    cost = 0.5 * jnp.sum((pose / jnp.asarray(POSE_SD, jnp.float32)[None]) ** 2, axis=-1)
    return moved_by(ev, pose, predicted_m), cost


@jax.jit
def left_over(
    ev: Evidence, w: Weights, fitted: Float[Array, " b"]
) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"]]:
    """Residuals of ln I (nats) and of the range (m) after reflectances and poses; 0 where they are not compared."""
    off_i = jnp.where(ev.compared, ev.log_intensity - ev.rays.log_intensity, 0)
    off_i = off_i - reflectance(ev, w, fitted, off_i)[0]
    smooth = ev.rays.hit & ev.returned & ~ev.edge
    off_r = jnp.where(smooth, ev.range_m - ev.rays.reading_m, 0)
    return off_i, jnp.where(smooth, off_r - pose_shift(ev, w, ev.rays.reading_m, smooth)[0], 0)
