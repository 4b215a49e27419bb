"""Echoes at depth steps are lost."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Bool

from jaxsim.effects.edits import lose
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

STEP_M, STEP_SHARE = 0.3, 0.05


def at_edge(rays: Rays) -> Bool[Array, "*n"]:
    """Whether a neighbour lies more than 0.3 m and 5 % of the range away, or hits nothing."""
    # Infinite neighbours count; 1e6 m keeps derivatives finite.
    beside_m = jnp.minimum(rays.beside_m, 1e6)
    apart = jnp.abs(beside_m - rays.range_m[..., None])
    least = jnp.maximum(STEP_SHARE * rays.range_m, STEP_M)
    return jnp.any(apart > least[..., None], axis=-1)


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Loses echoes at depth steps with one probability."""
    return lose(rays, jnp.where(at_edge(rays), p["probability"], jnp.zeros_like(rays.range_m)))


EFFECT = Effect(
    name="edge_dropout",
    stage="detection",
    title="returns are lost at depth steps",
    formula="keep *= 1 − probability where a neighbour is > 0.3 m and > 5 % of r away, or hits nothing",
    parameters={"probability": Parameter(0.0, 0.0, 0.95, "", "share of echoes lost at edges", scale=0.2)},
    channels=("drop",),
    signature="Returns are missing beside depth steps, and nowhere else.",
    covariates=("step",),
    look_alikes={
        "mixed_pixels": "mixed pixels return, between the two surfaces",
        "extrinsic_rotation": "a displaced edge reads the neighbour's range",
        "material_dropout": "compare edges and middles of one class",
        "random_dropout": "compare edges and middles",
    },
    source="SICK LMS4000 operating instructions (8023198, 2018), Edge filter: readings are removed where the distance "
    "to a neighbour exceeds a limit",
    apply=apply,
    starts=({"probability": 0.05},),
)
