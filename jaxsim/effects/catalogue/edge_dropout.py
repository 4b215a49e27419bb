"""Echoes at depth steps are lost."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Bool

from jaxsim.effects.edits import lose
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

STEP_M, STEP_SHARE = 0.3, 0.05
FAR_M = 1e6
"""In place of what is infinitely far, which would have no derivative."""
SHARPNESS = 20.0
"""Of the border: a step that is a fifth larger than the least counts for 97 %."""


def at_edge(rays: Rays) -> Bool[Array, "*n"]:
    """Whether a neighbour lies more than 0.3 m and 5 % of the range away, or hits nothing."""
    beside_m = jnp.minimum(rays.beside_m, FAR_M)
    apart = jnp.abs(beside_m - rays.range_m[..., None])
    least = jnp.maximum(STEP_SHARE * rays.range_m, STEP_M)
    return jnp.any(apart > least[..., None], axis=-1)


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Loses echoes at depth steps with one probability. Makers differ in what a step is, and whether the rows above and
    below are looked at, so these are parameters; the border is soft, for only then has it a derivative."""
    apart = jnp.abs(jnp.minimum(rays.beside_m, FAR_M) - rays.range_m[..., None])
    least = jnp.maximum(p["share"] * rays.range_m, STEP_M)
    steps = jax.nn.sigmoid(SHARPNESS * jnp.log(jnp.maximum(apart, 1e-3) / least[..., None]))
    along, across = steps[..., :2].max(-1), steps[..., 2:].max(-1)
    at = jnp.maximum(along, p["across_rows"] * across)
    return lose(rays, jnp.where(rays.hit, p["probability"] * at, jnp.zeros_like(at)))


EFFECT = Effect(
    name="edge_dropout",
    stage="detection",
    title="returns are lost at depth steps",
    formula="keep *= 1 − probability where a neighbour is > 0.3 m and > share · r away (a border that is soft by a "
    "fifth), or hits nothing; between rows keep *= 1 − across_rows · probability",
    parameters={
        "probability": Parameter(0.0, 0.0, 0.95, "", "share of echoes lost at edges", scale=0.2),
        "share": Parameter(STEP_SHARE, 0.01, 0.8, "", "least step that is an edge, over the range", scale=0.1),
        "across_rows": Parameter(
            1.0, 0.0, 1.0, "", "what steps to the rows above and below count, over those along the row", scale=0.3
        ),
    },
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
    starts=({"probability": 0.05}, {"probability": 0.3, "share": 0.25}, {"probability": 0.3, "across_rows": 0.2}),
)
