"""Weak echoes are not detected."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

LOGISTIC_SD = 1.702
"""Of the normal distribution nearest to a logistic of scale 1."""


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Keeps an echo with a logistic probability in the log of its power; of a power that is uncertain, the mean."""
    width = jnp.sqrt(jnp.square(p["width"]) + jnp.square(rays.log_power_sd / LOGISTIC_SD))
    keep = jax.nn.log_sigmoid((rays.log_power - p["threshold"]) / width)
    return replace(rays, log_keep=rays.log_keep + keep)


EFFECT = Effect(
    name="snr_dropout",
    stage="detection",
    title="echoes below a power are lost",
    formula="keep *= σ((ln P − threshold) / width)",
    parameters={
        "threshold": Parameter(-20.0, -20.0, 0.0, "ln P", "log power at which half the echoes are lost", scale=4.0),
        "width": Parameter(0.4, 0.1, 1.5, "nats", "softness of the threshold", scale=0.3),
    },
    channels=("drop",),
    signature="One curve of loss over predicted power holds for all classes, ranges and angles.",
    covariates=("power", "range"),
    look_alikes={
        "material_dropout": "compare classes at equal power",
        "range_gate": "a gate cuts at one range whatever the power",
        "atmospheric_extinction": "extinction dims the intensity too",
        "specular_lobe": "mirror loss is of vehicles alone",
    },
    source="Kilic et al., Lidar Light Scattering Augmentation (LISA), arXiv 2107.07004, 2021 (echoes below the power "
    "of the longest range are lost)",
    apply=apply,
    starts=tuple({"threshold": t} for t in (-10.0, -8.0, -7.0, -6.0, -5.0, -4.0, -3.0)),
)
