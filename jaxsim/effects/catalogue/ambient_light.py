"""The sun blinds the receiver in its direction."""

from __future__ import annotations

import numpy as np

from jaxsim.effects.edits import bump, lose
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Loses echoes around a direction of the world."""
    away = rays.azimuth_rad + rays.heading_rad - p["heading_rad"]
    return lose(rays, p["strength"] * bump(away, p["width_rad"]))


EFFECT = Effect(
    name="ambient_light",
    stage="detection",
    title="sunlight hides echoes in its direction",
    formula="keep *= 1 − strength · exp(−½((az + vehicle heading − heading)/width)²)",
    parameters={
        "strength": Parameter(0.0, 0.0, 0.95, "", "share of echoes lost towards the sun", scale=0.3),
        "heading_rad": Parameter(0.0, -np.pi, np.pi, "rad", "direction in the world", scale=1.5),
        "width_rad": Parameter(0.5, 0.1, 1.2, "rad", "standard width of the sector", scale=0.25),
    },
    channels=("drop",),
    signature="Returns are missing in a sector that stays in the world as the car turns; intensities are as they were.",
    covariates=("heading", "azimuth"),
    needs="heading",
    look_alikes={
        "window_contamination": "dirt turns with the car and dims; needs frames of several headings",
        "sector_occlusion": "a bracket turns with the car and blocks all",
    },
    source="Linnhoff et al., Measuring the Influence of Environmental Conditions on Automotive Lidar Sensors, Sensors "
    "22(14), 2022 (direct sunlight); Dudzik et al., Physically-Based Simulation of Automotive LiDAR, arXiv "
    "2512.05932, 2025 (ambient light)",
    apply=apply,
    starts=tuple({"strength": 0.2, "heading_rad": round(a, 3)} for a in np.linspace(-np.pi, np.pi, 13)[:-1].tolist()),
)
