"""How high the bar must be for the data at hand: measurements say in which nothing is missing.

Flexible candidates gain something on any data, because no null model is quite right, and how much depends on the data:
on the noise of the normals, on few scenes, on how materials are spread. So what is named must gain more than anything
did on any of these nulls: what the sensor would have said if the null model were true (`bootstrap`).

A null carries the data's own nuisances: gain and class reflectances; each street's levels, surfaces and pose, and what
is left of its intensities and ranges, with one sign a scene, so that what scenes share is gone and what belongs
together within one stays together (the wild cluster bootstrap of Cameron, Gelbach & Miller 2008); what the fit leaves
open of levels and poses; neighbours read at edges, readings far off, lost and false returns at their fitted rates;
effects that are in place already. Rounding is left out: a lattice is an effect.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.find.dependences import dependences_of
from jaxsim.discover.model.evidence import Evidence, near_enough
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.likelihood import log_reported, log_stray, near_sd
from jaxsim.discover.model.noise import DEGREES, range_variance
from jaxsim.discover.model.null_model import fit_null
from jaxsim.discover.model.random_effects import conditional_residuals, explained_by, frame_poses, levels_of, moved_by
from jaxsim.discover.name.candidates import Candidate, rank_effects
from jaxsim.discover.name.unexplained import free_curves, sure
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict import NullDraws
from jaxsim.effects import Effect
from jaxsim.effects.chain import sample
from jaxsim.effects.rays import CLUTTER_REACH_M, FLOOR, Rays
from jaxsim.frame import Array
from jaxsim.progress import Log

Array3 = Float[np.ndarray, "b c r"]


def draw_nulls(
    problem: Problem,
    explained: Problem,
    effects: Iterable[Effect],
    *,
    count: int,
    log: Log = lambda line: None,
) -> NullDraws:
    """The naming's first step on `count` nulls drawn from `problem`, and the bars that none of them passes, for effects
    and for free curves; at least the standing one."""
    catalogue = tuple(effects)
    scenes = len(np.unique(problem.ev.scene))
    names = []
    gains = []
    free = []
    for seed in range(count):
        drawn = bootstrap(problem, explained, seed)
        null = fit_null(problem.scan, drawn, clutter=problem.clutter)
        # All that `Candidate.accepted` asks but the bar, which is what is looked for.
        best = _strongest(c for c in rank_effects(null, catalogue) if c.scenes_agree and not c.smooth_is_enough)
        dependences = dependences_of(null)
        curve = _strongest(c for _, c in free_curves(null, dependences) if sure(c))
        names.append(best.effect.name if best else "")
        gains.append(best.total if best else 0.0)
        free.append(curve.total if curve else 0.0)
        text = f"{names[-1]} gains {gains[-1]:.1f} nats" if best else "no effect that scenes agree on"
        log(f"null {seed + 1} of {count}: {text}" + (f", a free curve gains {free[-1]:.1f}" if curve else ""))
    return NullDraws(
        effects=tuple(names),
        gains=tuple(gain / scenes for gain in gains),
        free=tuple(gain / scenes for gain in free),
        answered=sum(max(pair) > RULES.bar_nats for pair in zip(gains, free, strict=True)),
        bar=max(RULES.bar_nats, *gains) / scenes,
        free_bar=max(RULES.bar_nats, *free) / scenes,
    )


def _strongest(candidates: Iterable[Candidate]) -> Candidate | None:
    good = [candidate for candidate in candidates if candidate.total > 0]
    return max(good, key=lambda candidate: candidate.total) if good else None


def bootstrap(problem: Problem, explained: Problem, seed: int) -> Evidence:
    """`problem.ev` with returns, ranges and intensities drawn anew: its rays, which lack nothing, with the nuisances of
    `explained`, the problem with the effects in place that the data show. Equal seeds draw the same."""
    ev, rng = problem.ev, np.random.default_rng(seed)
    sign = rng.choice(np.array([-1, 1], np.float32), ev.scenes)[np.asarray(ev.scene)]
    off_i, off_r = conditional_residuals(explained.ev, explained.equations, ev.all_blocks)
    shine = _brighter(explained, np.asarray(off_i), sign, rng=rng)
    reading, returns, log_keep = _readings(problem, explained, np.asarray(off_r), sign=sign, rng=rng)
    lit = np.where(ev.rays.hit, ev.rays.log_intensity + shine, ev.rays.log_intensity)
    rays = replace(ev.rays, log_intensity=lit, reading_m=reading, hit=returns, log_keep=log_keep)
    # A sensor that reports zeros reports one where the light is below its lowest reading.
    zeros = bool((ev.intensity[np.asarray(ev.returned)] == 0).any())
    return _drawn_from(ev, rays, jax.random.key(seed), zeros=zeros)


def _drawn_from(ev: Evidence, rays: Rays, key: Array, *, zeros: bool) -> Evidence:
    """The evidence with one draw of what these rays may say; `zeros`: light below the lowest reading reads 0."""
    # Blocks of columns (b, c, r) as images (b, r, c), which `sample` draws.
    leaves = {f.name: getattr(rays, f.name) for f in fields(Rays)}
    turned = {n: jnp.swapaxes(x, 1, 2) if getattr(x, "ndim", 0) >= 3 else x for n, x in leaves.items()}
    image = sample(key, Rays(**turned))
    drawn_m = jnp.swapaxes(image.range_m, -1, -2)
    drawn = jnp.swapaxes(image.intensity, -1, -2)
    returned = jnp.swapaxes(image.valid, -1, -2)
    drawn = jnp.where(jnp.log(jnp.maximum(drawn, FLOOR)) < ev.lowest, 0.0, drawn) if zeros else drawn
    return replace(
        ev,
        returned=returned,
        range_m=drawn_m,
        log_intensity=jnp.log(jnp.maximum(drawn, FLOOR)),
        lift=jnp.zeros_like(drawn),
        compared=ev.compared & returned & near_enough(drawn_m, ev.rays.range_m),
    )


def _brighter(
    explained: Problem, residual_i: Array3, sign: Float[np.ndarray, " b"], *, rng: np.random.Generator
) -> Array3:
    """Nats by which each surface shines brighter than simulated, noise included (b, c, r)."""
    ev, w = explained.ev, explained.equations
    residual = np.where(ev.compared, ev.log_intensity - ev.rays.log_intensity, 0)
    levels = jax.tree.map(np.asarray, levels_of(ev, w, ev.all_blocks, residual=residual))

    def drawn_level(level: np.ndarray, block: Array, share: Array) -> np.ndarray:
        # A predicted level lacks the variance that its rays leave open: prediction with its sign, and that much drawn
        # anew.
        return sign[np.asarray(block)] * level + np.sqrt(np.asarray(share)) * _normal(rng, level.shape)

    street = sign[:, None] * levels.street + _correlated(rng, np.asarray(w.street))
    surface = drawn_level(levels.surface, w.surfaces.block, w.surfaces.variance)
    strip = drawn_level(levels.strip, w.strips.block, w.strips.variance)
    drawn = levels.replace(features=levels.shared[None] + street, surface=surface, strip=strip)
    compared = np.asarray(explained_by(ev, drawn)) + sign[:, None, None] * residual_i
    # Of rays that are not compared there is no residual; their class's reflectance, or that of all where none of it is
    # compared, and noise stand in.
    _, kind = np.unique(np.asarray(ev.rays.semantic), return_inverse=True)
    usual = 1 + len(ev.kinds)
    predicted = np.asarray(ev.features)[..., :usual] @ levels.shared[:usual]
    total = np.bincount(kind.ravel(), np.where(ev.compared, predicted, 0).ravel())
    count = np.bincount(kind.ravel(), np.asarray(ev.compared).ravel())
    of_class = np.where(count > 0, total / np.maximum(count, 1), levels.shared[0])[kind.reshape(residual_i.shape)]
    # Student-t, as the likelihood has it.
    speckle = np.exp(float(explained.noise.intensity)) * rng.standard_t(DEGREES, residual_i.shape)
    return np.where(np.asarray(ev.compared), compared, of_class + speckle).astype(np.float32)


def _readings(
    problem: Problem, explained: Problem, residual_m: Array3, *, sign: Float[np.ndarray, " b"], rng: np.random.Generator
) -> tuple[Array3, Bool[np.ndarray, "b c r"], Array3]:
    """Each ray's (b, c, r) reading, m; whether it may return; and the log of the probability that it does."""
    ev = explained.ev
    w = explained.equations
    noise = explained.noise
    rays = problem.ev.rays
    hit = np.asarray(rays.hit)
    shape = residual_m.shape
    # The pose: predicted and drawn like a level.
    pose = np.asarray(frame_poses(ev, w, ev.rays.reading_m, on=ev.returned & ev.rays.hit))
    pose = (sign[:, None] * pose + _correlated(rng, np.asarray(w.pose))).astype(np.float32)
    reading = np.asarray(rays.reading_m + moved_by(ev, pose, rays.reading_m))
    usual = reading + np.sqrt(np.asarray(range_variance(ev, noise))) * rng.standard_t(DEGREES, shape)

    # The parts of the range's mixture: the usual reading, a neighbour's, and one far off (Cauchy of 1 m).
    beside, has_neighbour = _one_beside(rays, rng)
    neighbour = beside + near_sd(beside) * _normal(rng, shape)
    log_switch, log_wide = log_stray(rays, ev, noise)
    switch = np.exp(np.asarray(log_switch))
    wide = np.exp(np.asarray(log_wide))
    # One number a ray decides between its neighbour's reading, a far outlier and the usual one.
    luck = rng.random(shape)
    astray = np.where(luck < switch, np.where(has_neighbour, neighbour, usual), reading + rng.standard_cauchy(shape))
    of_surface = np.where(luck < switch + wide, astray, usual)
    # Where the data compare a reading, its own residual stays, with the scene's sign.
    smooth = hit & np.asarray(ev.rays.hit & ev.returned & ~ev.edge)
    of_surface = np.where(smooth, reading + sign[:, None, None] * residual_m, of_surface)
    anywhere = rng.uniform(0, CLUTTER_REACH_M, shape)
    # Of a ray that hits nothing: its neighbour's surface or anything within reach, half and half.
    of_nothing = np.where((rng.random(shape) < 0.5) & has_neighbour, neighbour, anywhere)

    reported = np.asarray(log_reported(rays, ev, noise))
    false = ~hit & (rng.random(shape) < np.exp(reported))
    read = np.where(hit, of_surface, of_nothing).astype(np.float32)
    return read, hit | false, np.where(hit, reported, 0)


def _one_beside(rays: Rays, rng: np.random.Generator) -> tuple[Float[np.ndarray, "b c r"], Bool[np.ndarray, "b c r"]]:
    """The range of one of the neighbours that hit anything, by chance, and whether there is one (0 m where not)."""
    beside = np.asarray(rays.beside_m)
    hit = np.isfinite(beside)
    one = (rng.random(beside.shape) * hit).argmax(-1, keepdims=True)
    return np.take_along_axis(np.where(hit, beside, 0), one, axis=-1)[..., 0], np.asarray(hit.any(-1))


def _correlated(rng: np.random.Generator, covariance: Float[np.ndarray, "b k k"]) -> Float[np.ndarray, "b k"]:
    """Normal draws, one a block."""
    # Not by Cholesky: a covariance that is 0 in some directions has none.
    values, vectors = np.linalg.eigh(covariance.astype(np.float64))
    draws = np.sqrt(np.maximum(values, 0)) * _normal(rng, values.shape)
    return np.einsum("bij,bj->bi", vectors, draws).astype(np.float32)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    return rng.standard_normal(shape, np.float32)
