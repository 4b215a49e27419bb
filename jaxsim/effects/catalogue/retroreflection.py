"""Signs and lights send the light back where it came from."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import brighten, cosine, is_one_of
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

# Cityscapes ids of traffic lights and signs.
RETROREFLECTORS = (19, 20)
_SOFT = 4.0
"""A gain of 1/4 is where the cosine begins to give way; only then is the effect nothing at gain 0."""


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Gives signs and lights the light of normal incidence times exp(gain exp(-(θ / tolerance)²))."""
    lobe = p["gain"] * jnp.exp(-jnp.square(rays.incidence_rad / p["tolerance_rad"]))
    # Takes Lambert's cosine back: a retroreflector is bright at any angle within its tolerance.
    facing = -(1 - jnp.exp(-_SOFT * p["gain"])) * jnp.log(cosine(rays))
    return brighten(rays, is_one_of(rays, RETROREFLECTORS) * (facing + lobe))


EFFECT = Effect(
    name="retroreflection",
    stage="surface",
    title="signs and lights return light to its source",
    formula="signs, lights: I, P *= exp(gain · exp(−(θ/tolerance)²)) / (cos θ)^(1 − exp(−4 gain)): nearly the light of "
    "normal incidence",
    parameters={
        "gain": Parameter(0.0, 0.0, 6.0, "nats", "log brightness over a diffuse surface", scale=1.5),
        "tolerance_rad": Parameter(0.7, 0.3, 1.4, "rad", "angle at which the gain has fallen to 1/e", scale=0.3),
    },
    channels=("intensity",),
    signature="Traffic signs and lights are far brighter than simulated, up to incidence angles of 40 degrees, at all "
    "ranges.",
    covariates=("class", "incidence"),
    look_alikes={
        "saturation": "white paint saturates too; compare signs with it",
        "specular_lobe": "a lobe is of vehicles and narrow",
        "blooming": "blooming reaches neighbours of the sign and shows in range",
    },
    source="Velodyne VLP-16 User Manual (63-9243 rev. D, 2018), calibrated reflectivity (diffuse 0 to 100, "
    "retroreflectors 101 to 255)",
    apply=apply,
    starts=({"gain": 1.0}, {"gain": 3.0}),
)
