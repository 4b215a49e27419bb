"""Some returns are lost, whatever they hit."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import lose
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Loses each echo with one probability."""
    return lose(rays, jnp.broadcast_to(p["probability"], rays.log_keep.shape))


EFFECT = Effect(
    name="random_dropout",
    stage="detection",
    title="returns are lost at random, every ray alike",
    formula="keep *= 1 − probability",
    parameters={"probability": Parameter(0.0, 0.0, 0.9, "", "share of echoes lost", scale=0.05)},
    channels=("drop",),
    signature="The same share of returns is missing at every range, angle, class and power.",
    covariates=(),
    look_alikes={
        "packet_loss": "lost packets take whole columns",
        "snr_dropout": "a threshold spares strong echoes",
        "material_dropout": "compare classes",
    },
    source="Dosovitskiy et al., CARLA: An Open Urban Driving Simulator, CoRL 2017 (dropoff_general_rate of its "
    "ray-cast LiDAR)",
    apply=apply,
    starts=({"probability": 0.02},),
)
