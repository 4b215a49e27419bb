"""A measurement in which nothing is missing: what the sensor would have said if the null model were true.

It carries the data's own nuisances as they were fitted: gain and class reflectances; each street's levels, surfaces
and pose, with one sign a scene, so that what scenes share is gone, and what the fit leaves open of them; noise of
intensity and of the simulator's normals, of the range and the aim; neighbours read at edges, readings far off, lost
and false returns; effects that are in place already. Rounding is left out: a lattice is an effect.
"""

from __future__ import annotations

from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.evidence import Evidence, near_enough
from jaxsim.discover.fit import Problem
from jaxsim.discover.likelihood import DEGREES, log_reported, log_stray, near_sd
from jaxsim.discover.nuisance import OTHERS, range_variance
from jaxsim.discover.random_effects import explained_by, levels_of, moved_by, poses
from jaxsim.effects.draw import sample
from jaxsim.effects.rays import CLUTTER_REACH_M, FLOOR, Rays
from jaxsim.frame import Array

STEEP_RAD = 1.4
"""Normals are held to this incidence, as in the likelihood."""


def redraw(problem: Problem, seed: int) -> Evidence:
    """`problem.ev` with returns, ranges and intensities drawn from the null model; equal seeds draw the same."""
    ev, rng = problem.ev, np.random.default_rng(seed)
    sign = rng.choice(np.float32([-1, 1]), ev.units)[np.asarray(ev.unit)]
    rays = _brightened(problem, sign, rng)
    rays = _ranged(replace(problem, ev=replace(ev, rays=rays)), sign, rng)
    image = sample(jax.random.key(seed), _as_images(rays))
    drawn_m, shine, returned = (jnp.swapaxes(x, -1, -2) for x in (image.range_m, image.intensity, image.valid))
    zeros = bool((np.asarray(ev.log_intensity)[np.asarray(ev.returned)] <= np.log(FLOOR) + 1e-3).any())
    shine = jnp.where(jnp.log(jnp.maximum(shine, FLOOR)) < ev.lowest, 0.0, shine) if zeros else shine
    return replace(
        ev,
        returned=returned,
        range_m=drawn_m,
        log_intensity=jnp.log(jnp.maximum(shine, FLOOR)),
        compared=ev.compared & returned & near_enough(drawn_m, ev.rays.range_m),
    )


def _brightened(problem: Problem, sign: Float[np.ndarray, " b"], rng: np.random.Generator) -> Rays:
    """Rays whose surfaces have reflectances of their own, and noise."""
    ev, w, noise = problem.ev, problem.weights, problem.noise
    everyone = jnp.ones(len(ev.unit), jnp.float32)
    residual = jnp.where(ev.compared, ev.log_intensity - ev.rays.log_intensity, 0)
    levels = jax.tree.map(np.asarray, levels_of(ev, w, everyone, residual))
    # The curvature of noisy normals comes with their noise, below.
    shared = levels.shared.copy()
    shared[-OTHERS] = 0

    def own(level: np.ndarray, block: Array, share: Array) -> np.ndarray:
        return sign[np.asarray(block)] * level + np.sqrt(np.asarray(share)) * _normal(rng, level.shape)

    street = sign[:, None] * levels.street + _correlated(rng, np.asarray(w.street))
    surface = own(levels.surface, w.surfaces.block, w.surfaces.share)
    strip = own(levels.strip, w.strips.block, w.strips.share)
    drawn = levels.replace(features=shared[None] + street, surface=surface, strip=strip)
    kinds = np.unique(np.asarray(ev.rays.semantic))
    table = shared[0] + shared[1 : 1 + len(kinds)]
    of_class = table[np.searchsorted(kinds, np.asarray(ev.rays.semantic))]
    level = np.where(np.asarray(ev.compared), np.asarray(explained_by(ev, drawn)), of_class)

    shape = level.shape
    steep = np.minimum(np.asarray(ev.given_rad), STEEP_RAD)
    tilt, turn = (np.exp(float(noise.normals)) * _normal(rng, shape) for _ in range(2))
    facing = np.maximum(np.cos(steep + tilt) * np.cos(turn), 0.02)
    tilted = np.log(facing / np.cos(steep))
    speckle = np.exp(float(noise.intensity)) * rng.standard_t(DEGREES, shape)
    off = jnp.asarray(level + tilted + speckle, jnp.float32)
    return replace(ev.rays, log_intensity=jnp.where(ev.rays.hit, ev.rays.log_intensity + off, ev.rays.log_intensity))


def _ranged(problem: Problem, sign: Float[np.ndarray, " b"], rng: np.random.Generator) -> Rays:
    """Rays whose readings err as the null's do, and that return where one does."""
    ev, w, noise, rays = problem.ev, problem.weights, problem.noise, problem.ev.rays
    hit, shape = np.asarray(rays.hit), rays.hit.shape
    pose = np.asarray(poses(ev, w, rays.reading_m, ev.returned & rays.hit))
    pose = jnp.asarray(sign[:, None] * pose + _correlated(rng, np.asarray(w.pose)), jnp.float32)
    reading = np.asarray(rays.reading_m + moved_by(ev, pose, rays.reading_m))
    sd = np.sqrt(np.asarray(range_variance(ev, noise)))
    usual = reading + sd * rng.standard_t(DEGREES, shape)

    beside, known = _one_beside(rays, rng)
    neighbour = beside + near_sd(beside) * _normal(rng, shape)
    switch, wide = (np.exp(np.asarray(x)) for x in log_stray(ev, noise))
    luck = rng.random(shape)
    other = np.where(known, neighbour, usual)
    far = reading + rng.standard_cauchy(shape)
    of_surface = np.where(luck < switch, other, np.where(luck < switch + wide, far, usual))
    anywhere = rng.uniform(0, CLUTTER_REACH_M, shape)
    of_nothing = np.where((rng.random(shape) < 0.5) & known, neighbour, anywhere)

    reported = log_reported(rays, ev, noise)
    false = ~hit & (rng.random(shape) < np.exp(np.asarray(reported)))
    return replace(
        rays,
        hit=jnp.asarray(hit | false),
        reading_m=jnp.asarray(np.where(hit, of_surface, of_nothing), jnp.float32),
        log_keep=jnp.where(rays.hit, reported, 0.0),
    )


def _one_beside(rays: Rays, rng: np.random.Generator) -> tuple[Float[np.ndarray, "b c r"], Bool[np.ndarray, "b c r"]]:
    """The range of one of the four neighbours, by chance, and whether that hits anything (0 m where not)."""
    beside = np.asarray(rays.beside_m)
    one = np.take_along_axis(beside, rng.integers(0, 4, (*beside.shape[:-1], 1)), axis=-1)[..., 0]
    known = np.isfinite(one)
    return np.where(known, one, 0), known


def _correlated(rng: np.random.Generator, covariance: Float[np.ndarray, "b k k"]) -> Float[np.ndarray, "b k"]:
    """Normal draws, one a block."""
    values, vectors = np.linalg.eigh(covariance.astype(np.float64))
    draws = np.sqrt(np.maximum(values, 0)) * _normal(rng, values.shape)
    return np.einsum("bij,bj->bi", vectors, draws).astype(np.float32)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return rng.standard_normal(shape, np.float32)


def _as_images(rays: Rays) -> Rays:
    """Rays of blocks of columns (b, c, r) as images (b, r, c), which `sample` draws."""
    one = {f.name: getattr(rays, f.name) for f in fields(Rays)}
    return Rays(**{n: jnp.swapaxes(x, 1, 2) if getattr(x, "ndim", 0) >= 3 else x for n, x in one.items()})
