"""A bracket, a roof box or the bonnet stands before the sensor."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from jaxsim.effects.edits import wrapped
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import NEVER, Array, Rays

SOFT_RAD = 0.002
"""The echo's probability falls over this angle within what is hidden, so that its borders have a derivative: less than
half a column, or a fit that looks at few columns would move a border which all of them show."""


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Loses all echoes of a sector of azimuth, or of its lower part."""
    aside = p["width_rad"] / 2 - jnp.abs(wrapped(rays.azimuth_rad - p["azimuth_rad"]))
    inside = jnp.minimum(aside, p["below_rad"] - rays.elevation_rad)
    return replace(rays, log_keep=rays.log_keep + NEVER * jnp.clip(inside / SOFT_RAD, 0.0, 1.0))


EFFECT = Effect(
    name="sector_occlusion",
    stage="detection",
    title="a part of the car hides a sector",
    formula="keep = 0 where |az − azimuth| < width / 2 and el < below",
    parameters={
        "azimuth_rad": Parameter(0.0, -np.pi, np.pi, "rad", "middle of the sector, 0 forward", scale=1.5),
        "width_rad": Parameter(0.0, 0.0, 1.5, "rad", "full width of the sector", scale=0.2),
        "below_rad": Parameter(
            np.pi / 2, -np.pi / 2, np.pi / 2, "rad", "elevation up to which it is hidden; a bonnet is low", scale=0.1
        ),
    },
    channels=("drop",),
    signature="Nothing returns from one sector of azimuth, or its lower rows, in every frame, with sharp borders.",
    covariates=("azimuth", "column", "row"),
    look_alikes={
        "window_contamination": "dirt dims, has soft borders and lets strong echoes through",
        "packet_loss": "lost packets differ from frame to frame",
        "material_dropout": "a class that is lost in one sector alone is hidden there",
        "ambient_light": "the sun stays in the world as the car turns",
    },
    source="Velodyne VLS-128 User Manual, appendix H (what stands beside a sensor on the roof shadows azimuths, to be "
    "ignored)",
    apply=apply,
    starts=tuple(
        {"azimuth_rad": round(a, 3), "width_rad": w}
        for w in (0.1, 0.5)
        for a in np.linspace(-np.pi, np.pi, 25)[:-1].tolist()
    ),
)
