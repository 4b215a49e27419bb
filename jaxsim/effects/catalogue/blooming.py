"""Very bright targets glare into the rays beside them."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

ON_TARGET_RAD = 1e-6
"""A ray nearer than this meets the bright target itself: what it reads is no ghost."""


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Lets rays near a very bright target read its range, also those that hit nothing."""
    glare = p["probability"] * jnp.exp(-jnp.square(rays.glare_rad / p["radius_rad"]))
    # An angle of pi says that no glare is within reach; true angles are far below 3.
    beside = (rays.glare_rad > ON_TARGET_RAD) & (rays.glare_rad < 3.0)
    ghost = jnp.where(beside, glare, jnp.zeros_like(glare))
    return replace(rays, ghost=ghost, ghost_m=jnp.where(beside, rays.glare_m, rays.ghost_m))


EFFECT = Effect(
    name="blooming",
    stage="path",
    title="very bright targets show up in the rays around them",
    formula="reading = range of the nearest very bright target, with probability · exp(−(angle/radius)²)",
    parameters={
        "probability": Parameter(0.0, 0.0, 1.0, "", "share of readings taken over close to the target", scale=0.4),
        "radius_rad": Parameter(0.02, 0.004, 0.08, "rad", "angle at which it has fallen to 1/e", scale=0.015),
    },
    channels=("range",),
    signature="Around signs and other very bright targets, returns at exactly the target's range where the simulation "
    "hits something else or nothing.",
    covariates=("step", "range", "class"),
    look_alikes={
        "mixed_pixels": "mixed readings lie between the two surfaces, glare at the target's range",
        "extrinsic_rotation": "a displaced edge gains on one side and loses on the other",
        "precipitation_clutter": "clutter lies at any range",
    },
    source="Gump et al., Ghosts in the Point Clouds: De-glaring LiDAR in the Transient Domain, arXiv 2605.24753, "
    "2026; Dudzik et al., Physically-Based Simulation of Automotive LiDAR, arXiv 2512.05932, 2025",
    apply=apply,
    around_bright=True,
    starts=({"probability": 0.3}, {"probability": 0.3, "radius_rad": 0.05}),
)
