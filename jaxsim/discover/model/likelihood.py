"""Log-likelihood of measured frames under a simulation, by block and channel: the densities of `model` in one place.

Intensity: Student-t in its logarithm, with what piles up at the sensor's top and below its weakest reading. Return and
range: one mixture a ray: not returned, clutter, ghost, mixed pixels, or the surface's echo, whose range is the
predicted one (core), a neighbour's, or far off (wide). Columns may be lost whole.
The drop channel is the part of the mixture that says whether a ray returned; the rest is the range channel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.noise import DEGREES, Noise, intensity_variance, reading_variance
from jaxsim.discover.model.noise_levels import FINEST, lattice_step, log_rounding
from jaxsim.discover.model.random_effects import NormalEquations, pose_shift, reflectance
from jaxsim.discover.rules import RULES
from jaxsim.effects import get_effect
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.rays import CLUTTER_REACH_M, FLOOR, NEVER, Rays
from jaxsim.frame import Array

MOST_LIKELY = 0.999
"""Probabilities that effects give rays are held below this, so that what they rule out keeps a finite logarithm."""
_STUDENT_AT_0 = math.log(3 / 8)
"""Logarithm of the density of Student-t with 4 degrees at 0, scale 1."""
_PILE = 0.01
"""Intensities within this (nats) of the sensor's top count as at the top."""
_ABOVE_TOP = 10.0
"""Nats that a reading above the top costs: it refutes the top, yet one faulty reading must not decide."""
_NOTHING = math.log(FLOOR) + 1e-3
"""ln I below which a reading is a 0."""
_EDGE_SD_M = 0.05
"""Standard deviation of a neighbour's reading near by, and the softness of the ends of what lies between two
surfaces."""
_EDGE_PART = 0.02
"""What a neighbour's reading is off beside that, as a share of the range: surfaces go on between rays."""
_GHOST_M = 0.1
"""What a ghost's reading is off beside the noise of ranges."""
_NODES = 16
"""Of the sum that normalises the density of false returns."""
_LOGISTIC = 1.6
"""Times its argument the logistic function is nearly the normal distribution's."""
_WIDE_M = 1.0
"""Half width at half height of readings far off."""
_FAR_M = 1e4
"""Where a neighbour that hits nothing is put: no reading is near it."""


def log_normal(d: Float[Array, "*n"], sd: Float[Array, "*#n"]) -> Float[Array, "*n"]:
    """Logarithm of the normal density at a distance d from its mean."""
    return -0.5 * (d / sd) ** 2 - jnp.log(sd) - 0.5 * math.log(2 * math.pi)


def log_student(d: Float[Array, "*n"], sd: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Logarithm of the density of a Student-t of DEGREES degrees of freedom and scale `sd`."""
    return _STUDENT_AT_0 - 0.5 * (DEGREES + 1) * jnp.log1p((d / sd) ** 2 / DEGREES) - jnp.log(sd)


def log_below(t: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Logarithm of the probability that a Student-t of 4 degrees of freedom and scale 1 lies below t."""
    square = t**2 / DEGREES
    # With 4 degrees of freedom the distribution function has a closed form.
    share = 0.5 + 0.375 * t / jnp.sqrt(1 + square) * (1 - t**2 / 12 / (1 + square))
    # Far below 0 the sum cancels; the tail falls with the fourth power.
    return jnp.log(jnp.where(t < -6, 3 / 16 / (1 + square) ** 2, jnp.maximum(share, 1e-4)))


def log_cauchy(d: Float[Array, "*n"], scale: float) -> Float[Array, "*n"]:
    """Logarithm of the Cauchy density."""
    return -jnp.log(math.pi * scale * (1 + (d / scale) ** 2))


def intensity_terms(
    rays: Rays, ev: Evidence, noise: Noise, *, equations: NormalEquations, in_fit: Float[Array, " b"]
) -> tuple[Float[Array, "b c r"], Float[Array, " b"]]:
    """Log-density of each compared ray's ln I, 0 elsewhere; and what surfaces' levels cost each block, nats."""
    residual = ev.log_intensity - rays.log_intensity
    explained, cost = reflectance(ev, equations, in_fit, residual=residual)
    unexplained = residual - explained
    # A lattice is uniform within a step of I; of ln I, the same over I. Below e^-7 no ray is compared.
    rounding = rays.intensity_step / math.sqrt(12) * jnp.exp(-jnp.clip(ev.log_intensity, -7.0, 0.0))
    variance = intensity_variance(ev, noise) + rounding**2
    sd = jnp.sqrt(variance)
    density = log_student(unexplained, sd)
    # A reading of 0 says no more than that the intensity lies below all others.
    nothing = ev.log_intensity - ev.lift <= _NOTHING
    density = jnp.where(nothing, log_below((ev.lowest - (ev.log_intensity - unexplained)) / sd), density)
    # At the sensor's top: all that would be brighter piles up there, spread over the _PILE on both sides of the top.
    top = jnp.log(rays.intensity_top)
    over = (ev.log_intensity - unexplained - top) / sd
    gap = ev.log_intensity - top
    piled = jax.nn.log_sigmoid(_LOGISTIC * over) - math.log(2 * _PILE)
    # A top of 1 is where every sensor's scale ends: nothing is cut off.
    clipped = rays.intensity_top < 0.9999
    density = jnp.where(clipped & (jnp.abs(gap) <= _PILE), piled, density)
    density = jnp.where(clipped & (gap > _PILE), density - _ABOVE_TOP, density)
    return jnp.where(ev.compared, density, 0.0), cost


def log_clutter(rays: Rays, at_m: Float[Array, "b c r"]) -> Float[Array, "b c r"]:
    """Log-density of the range of a false return before the surface: r^power exp(-r / scale), between `clutter_from_m`
    and the surface, normalised by a sum."""
    end = jnp.where(rays.hit, jnp.maximum(rays.range_m, rays.clutter_from_m + 0.1), CLUTTER_REACH_M)
    start = rays.clutter_from_m

    def log_shape(r: Float[Array, "b c r"]) -> Float[Array, "b c r"]:
        return rays.clutter_power * jnp.log(r) - r / rays.clutter_scale_m

    # Midpoint rule on a logarithmic scale: the densities are broad on it.
    length = jnp.log(end / start)
    mass = jnp.zeros_like(end)
    for k in range(_NODES):
        r = start * jnp.exp(length * ((k + 0.5) / _NODES))
        mass = mass + jnp.exp(log_shape(r)) * r * length / _NODES
    inside = (at_m > start) & (at_m < end + 1.0)
    r = jnp.clip(at_m, start, end)
    return jnp.where(inside, log_shape(r) - jnp.log(mass + 1e-30), NEVER)


def near_sd(range_m: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Standard deviation of a neighbour's reading, m."""
    return _EDGE_SD_M + _EDGE_PART * range_m


def log_stray(rays: Rays, ev: Evidence, noise: Noise) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"]]:
    """Logarithms of the probabilities that a surface's echo reads a neighbour's range, as far as these hit anything,
    and one far off."""
    neighbours = jnp.isfinite(rays.beside_m).mean(-1)
    switch = jnp.where(ev.edge, jax.nn.log_sigmoid(noise.switch_edge) + jnp.log(neighbours + 1e-9), NEVER)
    return switch, jnp.where(ev.edge, jax.nn.log_sigmoid(noise.wide_edge), jax.nn.log_sigmoid(noise.wide))


def log_echo(rays: Rays, ev: Evidence, noise: Noise) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"]]:
    """Logarithms of the probabilities that a ray which hits something brings back the echo of its surface, and, while
    this is lost, that of a neighbour: a ray which meets the background beside a post is not what hides the post."""
    stepped = jnp.logical_or(ev.edge, ev.step)
    missed = jnp.where(stepped, jax.nn.log_sigmoid(-noise.drop_edge), jax.nn.log_sigmoid(-noise.drop))
    # Silhouettes lose more than other edges: the later line wins.
    missed = jnp.where(jnp.isfinite(rays.beside_m).all(-1), missed, jax.nn.log_sigmoid(-noise.drop_sky))
    switch, _ = log_stray(rays, ev, noise)
    own_lost = jnp.log(-jnp.expm1(jnp.minimum(rays.log_keep, -1e-6)))
    return rays.log_keep + missed, jnp.maximum(own_lost + switch + missed, NEVER)


def log_false(ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    """Logarithm of the probability that a ray which hits nothing returns."""
    return jnp.where(ev.edge, jax.nn.log_sigmoid(noise.false_edge), jax.nn.log_sigmoid(noise.false))


def log_reported(rays: Rays, ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    """Logarithm of the probability that a ray returns: an echo of its surface or of a neighbour's, or a false one where
    nothing is hit."""
    own, beside = log_echo(rays, ev, noise)
    echo = jnp.logaddexp(own, beside)
    return jnp.clip(jnp.where(rays.hit, echo, log_false(ev, noise)), NEVER, -1e-6)


def log_lost(rays: Rays, ev: Evidence, noise: Noise, *, clutter: bool = True) -> Float[Array, "b c r"]:
    """Logarithm of the probability that a ray that is not lost with its column does not return."""
    # A ray may return in three independent ways, an echo, a ghost or clutter: lost is what none of them brings back.
    lost = jnp.log(-jnp.expm1(log_reported(rays, ev, noise))) + jnp.log1p(-jnp.clip(rays.ghost, 0, MOST_LIKELY))
    return lost + jnp.log1p(-jnp.clip(rays.clutter, 0, MOST_LIKELY)) if clutter else lost


def return_terms(
    rays: Rays, ev: Evidence, noise: Noise, *, equations: NormalEquations, clutter: bool
) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"], Float[Array, " b"]]:
    """Gives `log_lost`; the logarithm of the density with which a ray returns where it did; and what each block's pose
    costs. Without `clutter` its component is left out, which no ray has then."""
    off = ev.range_m - rays.reading_m
    shift, cost = pose_shift(ev, equations, rays.reading_m, on=ev.returned & rays.hit)
    off = off - shift

    near = _log_near(rays, ev)
    stray = log_stray(rays, ev, noise)
    surface = _log_surface(ev, stray, off=off, near=near, sd=jnp.sqrt(reading_variance(rays, ev, noise)))
    surface = _mix(rays.between, surface, _log_between(rays, ev))
    # Where nothing is predicted, half of the returns are a neighbour's surface, the others may lie anywhere.
    nothing = jnp.logaddexp(near, -math.log(CLUTTER_REACH_M)) - math.log(2)
    own, beside = log_echo(rays, ev, noise)
    echo = jnp.logaddexp(own + surface, beside + near)
    returned = jnp.where(rays.hit, echo, log_false(ev, noise) + nothing)
    ghost = log_normal(ev.range_m - rays.ghost_m, jnp.exp(noise.range_) + _GHOST_M)
    returned = _mix(rays.ghost, returned, ghost)
    # An early return hides all that comes behind it.
    if clutter:
        returned = _mix(rays.clutter, returned, log_clutter(rays, ev.range_m))
    return log_lost(rays, ev, noise, clutter=clutter), jnp.where(ev.returned, returned, 0.0), cost


def _mix(share: Float[Array, "*#n"], usual: Float[Array, "*n"], instead: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Log-density of a mixture of two, of which `instead` has the given share."""
    share = jnp.clip(share, 0, MOST_LIKELY)
    return jnp.logaddexp(jnp.log1p(-share) + usual, jnp.log(share + 1e-12) + instead)


def _log_near(rays: Rays, ev: Evidence) -> Float[Array, "b c r"]:
    """A neighbour's echo: normal about the range of one of those that hit anything, whichever it is."""
    hit = jnp.isfinite(rays.beside_m)
    near = log_normal(ev.range_m[..., None] - jnp.where(hit, rays.beside_m, _FAR_M), near_sd(ev.range_m[..., None]))
    return jax.nn.logsumexp(near, axis=-1) - jnp.log(jnp.maximum(hit.sum(-1), 1))


def _log_surface(
    ev: Evidence,
    stray: tuple[Float[Array, "b c r"], Float[Array, "b c r"]],
    *,
    off: Float[Array, "b c r"],
    near: Float[Array, "b c r"],
    sd: Float[Array, "b c r"],
) -> Float[Array, "b c r"]:
    """The surface's echo: a core (Student-t) about the predicted range, a wide part about it, and, at edges, a
    neighbour's echo; the logarithms of the shares of these two are `stray`, in the order of `log_stray`. The wide part
    is Cauchy's; at edges it is half even before the surface, where a beam of some width meets what single rays pass
    by."""
    core = log_student(off, sd)
    wide = log_cauchy(off, _WIDE_M)
    expected = jnp.maximum(ev.range_m - off, _WIDE_M)
    before = jnp.where(off < 0, -jnp.log(expected), NEVER)
    wide = jnp.where(ev.edge, jnp.logaddexp(wide, before) - math.log(2), wide)
    switch, rate = stray
    # What neither strays nor switches is core: 2 % of it stay, whatever rates a step of the fit tries.
    usual = jnp.log1p(-jnp.clip(jnp.exp(rate) + jnp.exp(switch), 0, 0.98))
    return jax.nn.logsumexp(jnp.stack([usual + core, rate + wide, switch + near], axis=-1), axis=-1)


def _log_between(rays: Rays, ev: Evidence) -> Float[Array, "b c r"]:
    """A mixed pixel: even between the surface and the one beside it, with soft ends."""
    low, high = jnp.minimum(rays.reading_m, rays.between_m), jnp.maximum(rays.reading_m, rays.between_m)
    inside = jax.nn.sigmoid((ev.range_m - low) / _EDGE_SD_M) * jax.nn.sigmoid((high - ev.range_m) / _EDGE_SD_M)
    # Uniform: 1 over the width of the gap, to which the soft ends add.
    return jnp.log(inside + 1e-9) - jnp.log(high - low + _EDGE_SD_M)


def of_columns(
    rays: Rays, ev: Evidence, *, lost: Float[Array, "b c r"], returned: Float[Array, "b c r"]
) -> Float[Array, "b c"]:
    """Log-likelihood of whole columns, which may be lost together: then every ray of them is."""
    terms = jnp.where(ev.returned, returned, lost).sum(-1)
    # Rays of a column have the same probability; the mean keeps derivatives of each.
    gone = jnp.clip(rays.column_loss.mean(-1), 0, MOST_LIKELY)
    empty = ~ev.returned.any(-1)
    # Lost whole, or ray by ray; where anything returned, only the latter.
    return jnp.logaddexp(jnp.log1p(-gone) + terms, jnp.where(empty, jnp.log(gone + 1e-9), NEVER * 10))


def intensity_by_block(
    rays: Rays, ev: Evidence, noise: Noise, *, equations: NormalEquations, in_fit: Float[Array, " b"]
) -> Float[Array, " b"]:
    """Log-likelihood of the intensities, what surfaces' reflectances cost taken off."""
    terms, cost = intensity_terms(rays, ev, noise, equations=equations, in_fit=in_fit)
    return terms.sum((1, 2)) - cost


def returns_by_block(
    rays: Rays, ev: Evidence, noise: Noise, *, equations: NormalEquations, clutter: bool
) -> tuple[Float[Array, " b"], Float[Array, " b"]]:
    """Log-likelihood of the ranges, what the pose costs taken off, and of what returned."""
    lost, returned, cost = return_terms(rays, ev, noise, equations=equations, clutter=clutter)
    total = of_columns(rays, ev, lost=lost, returned=returned).sum(-1)
    # The drop channel alone: the same columns, of which it is known only which rays returned.
    any_return = jnp.log(-jnp.expm1(jnp.minimum(lost, -1e-7)))
    drop = of_columns(rays, ev, lost=lost, returned=any_return).sum(-1)
    return total - drop - cost, drop


@partial(jax.jit, static_argnames="clutter")
def log_likelihood(
    ev: Evidence, noise: Noise, *, equations: NormalEquations, in_fit: Float[Array, " b"], clutter: bool
) -> Float[Array, "b 3"]:
    """Log-likelihood of every block by channel (intensity, range, drop), of the rays as they stand: what
    `gradients.value_and_gradient` gives without derivatives."""
    range_, drop = returns_by_block(ev.rays, ev, noise, equations=equations, clutter=clutter)
    intensity = intensity_by_block(ev.rays, ev, noise, equations=equations, in_fit=in_fit)
    return jnp.stack([intensity, range_, drop], axis=-1)


def rounded(ev: Evidence) -> dict[str, float]:
    """Steps of the lattices on which the sensor's readings lie and the simulator's do not, by effect."""
    returned = np.asarray(ev.returned)
    simulated = dict(zip(FINEST, np.asarray(ev.own_step), strict=True))
    steps = {}
    for name, measured in _readings(ev).items():
        step = lattice_step(measured[returned], finest=FINEST[name])
        if step > RULES.coarser_step * simulated[name]:
            steps[name] = step
    return steps


def rounding_gain(ev: Evidence, steps: Mapping[str, float]) -> Float[np.ndarray, "b 3"]:
    """Nats that each block's readings gain, by channel, where they are known to lie on the lattices of `steps` (by
    effect; steps that count as no rounding gain nothing)."""
    gain = np.zeros((len(ev.scene), len(CHANNELS)))
    returned = np.asarray(ev.returned)
    for name, values in _readings(ev).items():
        if steps.get(name, 0.0) > FINEST[name]:
            # A step at or below the finest is how files hold readings, no effect.
            nats = log_rounding(values, steps[name], finest=FINEST[name])
            channel = CHANNELS.index(get_effect(name).channels[0])
            gain[:, channel] = np.where(returned, nats, 0).sum((1, 2))
    return gain


def step_known_to(ev: Evidence, name: str, step: float) -> float:
    """How far the step of a lattice that readings lie on may be off: at the largest of them a wrong one would be off
    by as much as counts as on the lattice."""
    largest = float(np.max(_readings(ev)[name][np.asarray(ev.returned)], initial=step))
    return RULES.lattice_near * step * step / largest


def _readings(ev: Evidence) -> dict[str, Float[np.ndarray, "b c r"]]:
    """What the sensor read, by the effect that rounds it."""
    return {"intensity_quantization": ev.intensity, "range_quantization": np.asarray(ev.range_m)}
