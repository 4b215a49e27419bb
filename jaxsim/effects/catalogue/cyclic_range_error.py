"""Clocks and phases that are interpolated unevenly: an error that comes back with the range."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import misread
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds a wave of the range to the reading."""
    # A ray that meets nothing has no range to go round with.
    phase = 2 * jnp.pi * p["cycles_per_m"] * jnp.where(rays.hit, rays.range_m, 0.0)
    return misread(rays, p["sine_m"] * jnp.sin(phase) + p["cosine_m"] * jnp.cos(phase))


EFFECT = Effect(
    name="cyclic_range_error",
    stage="ranging",
    title="ranges are too long and too short in turn, as they grow",
    formula="reading += sine · sin(2π·cycles_per_m·r) + cosine · cos(2π·cycles_per_m·r)",
    parameters={
        "sine_m": Parameter(0.0, -0.3, 0.3, "m", "amplitude of the part that is 0 at the sensor", scale=0.03),
        "cosine_m": Parameter(0.0, -0.3, 0.3, "m", "amplitude of the other part", scale=0.03),
        "cycles_per_m": Parameter(0.25, 0.08, 4.0, "1/m", "waves in a metre of range", scale=0.25),
    },
    channels=("range",),
    signature="The range residual is a wave along the range, the same for all beams, angles and classes.",
    covariates=("range",),
    look_alikes={
        "range_offset": "an offset has one sign at all ranges",
        "range_scale": "a scale grows with the range and does not turn back",
        "beam_range_bias": "on a flat road each beam has a range of its own; compare walls within a beam",
        "range_noise": "noise differs between turns of a standing sensor, and between neighbours",
        "range_quantization": "a lattice leaves the readings on steps",
    },
    source="Rüeger, Electronic Distance Measurement, 4th edition, Springer 1996 (cyclic errors); Lichti, ISPRS Journal "
    "of Photogrammetry and Remote Sensing 61(5), 2007 (of terrestrial laser scanners)",
    apply=apply,
)
