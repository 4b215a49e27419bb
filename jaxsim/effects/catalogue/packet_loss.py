"""Network packets are lost, with the columns they carry."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.edits import either
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Sets the probability that a ray's group of columns is lost; groups are drawn with the frame."""
    return replace(rays, column_loss=either(rays.column_loss, jnp.broadcast_to(p["probability"], rays.range_m.shape)))


EFFECT = Effect(
    name="packet_loss",
    stage="detection",
    title="groups of whole columns are lost",
    formula="groups of `columns` columns are lost with a probability, anew in each frame",
    parameters={
        "probability": Parameter(0.0, 0.0, 0.5, "", "share of groups lost", scale=0.05),
        "columns": Parameter(4.0, 1.0, 32.0, "columns", "in a group", scale=4.0, to_fit=False),
    },
    channels=("drop",),
    signature="Whole columns are missing side by side, others each frame.",
    covariates=("column", "frame"),
    look_alikes={
        "random_dropout": "look at single columns: packets take all of one",
        "sector_occlusion": "a sector is the same in every frame",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix E (a UDP "
    "packet holds several firings of all lasers)",
    apply=apply,
    starts=({"probability": 0.02},),
)
