"""Dirt or water on the sensor's window."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from jaxsim.effects.edits import brighten, bump, lose
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Dims and loses echoes in a patch of azimuth that turns with the car."""
    blocked = p["loss"] * bump(rays.azimuth_rad - p["azimuth_rad"], p["width_rad"])
    return lose(brighten(rays, jnp.log1p(-blocked)), p["drop"] * blocked)


EFFECT = Effect(
    name="window_contamination",
    stage="path",
    title="a dirty or wet patch of the sensor's window",
    formula="b = exp(−½((az − azimuth)/width)²):  ln I, ln P += ln(1 − loss·b);  keep *= 1 − drop·loss·b",
    parameters={
        "loss": Parameter(0.0, 0.0, 0.95, "", "share of light lost in the middle of the patch", scale=0.35),
        "azimuth_rad": Parameter(0.0, -np.pi, np.pi, "rad", "middle of the patch, 0 forward", scale=1.5),
        "width_rad": Parameter(0.3, 0.05, 1.0, "rad", "standard width of the patch", scale=0.2),
        "drop": Parameter(0.0, 0.0, 1.0, "", "echoes lost for each share of light lost", scale=0.3),
    },
    channels=("intensity", "drop"),
    signature="A patch of azimuth is darker and loses returns, in every frame, whatever the heading.",
    covariates=("azimuth", "column"),
    look_alikes={
        "ambient_light": "the sun stays in the world as the car turns, and leaves the intensity alone",
        "sector_occlusion": "a bracket blocks all and has sharp borders",
        "emitter_drift": "compare azimuths",
    },
    source="Pao et al., Investigation of Automotive LiDAR Vision in Rain from Material and Optical Perspectives, "
    "Sensors 24(10), 2024 (points missing and darker behind drops on the cover)",
    apply=apply,
    starts=tuple({"loss": 0.2, "azimuth_rad": round(a, 3)} for a in np.linspace(-np.pi, np.pi, 13)[:-1].tolist()),
)
