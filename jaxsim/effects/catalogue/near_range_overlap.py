"""Close by, the receiver does not see all of the lit spot."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import brighten
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

# (r / distance)^2 is kept between these: ln(1 - exp(-square)) and its slope are finite there in float32.
_LEAST = 1e-4
_MOST = 60.0


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Multiplies power and intensity by 1 - depth exp(-(r / distance)²)."""
    # Makers differ in how much is lost at the sensor itself: all where two apertures lie side by side, a part where
    # one stands within the other.
    square = jnp.square(rays.range_m / jnp.maximum(p["distance_m"], 1e-2))
    seen = jnp.log1p(-p["depth"] * jnp.exp(-jnp.clip(square, _LEAST, _MOST)))
    return brighten(rays, jnp.where(rays.hit, seen, jnp.zeros_like(seen)))


EFFECT = Effect(
    name="near_range_overlap",
    stage="path",
    title="close by, transmitter and receiver do not look at the same spot",
    formula="I, P *= 1 − depth · exp(−(r/distance)²)",
    parameters={
        "distance_m": Parameter(0.0, 0.0, 12.0, "m", "range at which 63 % of what is lost is seen again", scale=3.0),
        "depth": Parameter(1.0, 0.05, 1.0, "", "share of the light that is not seen at the sensor", scale=0.3),
    },
    channels=("intensity",),
    signature="Intensity is missing at the smallest ranges, of all classes and beams, and nowhere else.",
    covariates=("range",),
    look_alikes={
        "focal_compensation": "a compensation differs from beam to beam",
        "range_falloff": "falloff goes on at long range",
        "beam_gain": "near by, a row is a range; compare other surfaces in the same rows",
        "saturation": "saturation spares dark surfaces",
    },
    source="Mukupa et al., Correction of Terrestrial LiDAR Data Using a Hybrid Model, FIG Working Week 2017 (1 to 6 "
    "m); Hahner et al., LiDAR Snowfall Simulation for Robust 3D Object Detection, CVPR 2022 (overlap of a bistatic "
    "sensor)",
    apply=apply,
    starts=({"distance_m": 2.0}, {"distance_m": 4.0}, {"distance_m": 8.0}, {"distance_m": 8.0, "depth": 0.4}),
)
