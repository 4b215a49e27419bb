"""The car moves while the sensor turns, and nobody corrects it."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import displace
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

SCAN_S = 0.1
"""Time of a turn at 10 Hz."""


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Moves the origin along x by share * speed * 0.1 s * (place within the scan - 1/2)."""
    # In the middle of the turn, of which the frame is, nothing is displaced.
    forward = p["share"] * rays.speed_mps * SCAN_S * (rays.phase - 0.5)
    return displace(rays, move_m=(forward, jnp.zeros_like(forward), jnp.zeros_like(forward)))


EFFECT = Effect(
    name="motion_distortion",
    stage="geometry",
    title="the car moves during a scan and the scan is not corrected for it",
    formula="true origin = nominal origin + share · speed · 0.1 s · (u − ½) forward",
    parameters={
        "share": Parameter(
            0.0,
            -1.5,
            1.5,
            "",
            "share of the motion that is left in the scan; below 0 where it was corrected too far, or where speeds or "
            "the sense of the turn have the other sign",
            scale=0.5,
        ),
    },
    channels=("range", "intensity", "drop"),
    signature="A range residual proportional to speed, to the place within the scan and to the cosine of the azimuth; "
    "it jumps where the scan begins and ends, and is nothing at standstill.",
    covariates=("speed", "time", "azimuth", "column", "range"),
    needs="speed",
    look_alikes={
        "extrinsic_translation": "a wrong mounting stays at standstill; compare speeds",
        "extrinsic_rotation": "compare speeds",
    },
    source="Zhang & Singh, LOAM: Lidar Odometry and Mapping in Real-time, RSS 2014 (distortion by motion within a "
    "sweep)",
    apply=apply,
    casts=3,
)
