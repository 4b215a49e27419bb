"""Fog itself returns light."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import add_clutter
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds early returns at a range that is typical of the fog's density."""
    probability = jnp.where(rays.hit, p["probability"], jnp.zeros_like(rays.clutter))
    # r^2 exp(-r / scale) has a mean of 3 scales.
    return add_clutter(rays, probability, power=2.0, scale_m=p["scale_m"], from_m=0.5, intensity=p["intensity"])


EFFECT = Effect(
    name="fog_backscatter",
    stage="path",
    title="fog returns light of its own",
    formula="early return with a probability where the ray hits, range density ∝ r² exp(−r/scale) on (0.5 m, surface)",
    parameters={
        "probability": Parameter(0.0, 0.0, 0.9, "", "share of rays with a return from the fog", scale=0.1),
        "scale_m": Parameter(2.0, 0.5, 10.0, "m", "a third of the mean range", scale=1.5),
        "intensity": Parameter(0.05, 0.005, 0.5, "", "reported for them", scale=0.05),
    },
    channels=("range", "intensity"),
    signature="Weak returns in a ring of a few metres around the sensor, in front of whatever is there.",
    covariates=("range", "intensity"),
    clutter=True,
    look_alikes={
        "precipitation_clutter": "rain is densest at the sensor and thins out; fog has a ring",
        "interference": "interference is uniform in range",
        "mixed_pixels": "mixed readings need a depth step",
    },
    source="Hahner et al., Fog Simulation on Real LiDAR Point Clouds, ICCV 2021 (soft target, always beside "
    "extinction)",
    apply=apply,
    starts=({"probability": 0.03}, {"probability": 0.03, "scale_m": 5.0}),
)
