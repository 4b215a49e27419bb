"""Rain drops and snow flakes return light."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import add_clutter
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds early returns that thin out with a power of range and with extinction."""
    probability = jnp.where(rays.hit, p["probability"], jnp.zeros_like(rays.clutter))
    # Of single drops the echo falls with the square of range; where a threshold spares none of them, all count alike.
    law = {"power": -p["thinning"], "scale_m": p["scale_m"], "from_m": 1.5}
    return add_clutter(rays, probability, **law, intensity=p["intensity"])


EFFECT = Effect(
    name="precipitation_clutter",
    stage="path",
    title="drops and flakes return light",
    formula="early return with a probability where the ray hits, range density ∝ r^−thinning · exp(−r/scale) on "
    "(1.5 m, surface)",
    parameters={
        "probability": Parameter(0.0, 0.0, 0.9, "", "share of rays with a return from a drop", scale=0.1),
        "scale_m": Parameter(20.0, 2.0, 200.0, "m", "range at which extinction thins them out", scale=15.0),
        "intensity": Parameter(0.05, 0.005, 0.5, "", "reported for them", scale=0.05),
        "thinning": Parameter(2.0, 0.0, 2.0, "", "power of range with which they thin out besides", scale=0.5),
    },
    channels=("range", "intensity"),
    signature="Scattered weak returns in front of surfaces, most of them at the shortest ranges.",
    covariates=("range", "intensity"),
    clutter=True,
    look_alikes={
        "fog_backscatter": "fog has a ring at some metres, rain is densest at the sensor",
        "interference": "interference is uniform in range and not always weak",
        "mixed_pixels": "mixed readings need a depth step",
    },
    source="Kilic et al., Lidar Light Scattering Augmentation (LISA), arXiv 2107.07004, 2021; Hahner et al., LiDAR "
    "Snowfall Simulation for Robust 3D Object Detection, CVPR 2022",
    apply=apply,
    starts=({"probability": 0.03}, {"probability": 0.03, "scale_m": 8.0, "thinning": 0.3}),
)
