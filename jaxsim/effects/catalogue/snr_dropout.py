"""Weak echoes are not detected."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
from jax.scipy.special import ndtr

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

LOGISTIC_SD = 1.702
"""Of the normal distribution nearest to a logistic of scale 1."""


LEAST_SD = 1e-3
"""Nats: an intensity that is known is taken as known to this, so that the limit has a derivative."""


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Keeps an echo with a logistic probability in the log of its power, and of intensities under a limit a share that
    falls in proportion; of a power that is uncertain, the mean."""
    width = jnp.sqrt(jnp.square(p["width"]) + jnp.square(rays.log_power_sd / LOGISTIC_SD))
    keep = jax.nn.log_sigmoid((rays.log_power - p["threshold"]) / width)
    faint = p["zero_loss"] * below(p["limit"], rays)
    return replace(rays, log_keep=rays.log_keep + keep + jnp.log1p(-faint))


def below(limit: Array, rays: Rays) -> Array:
    """How far intensities lie below a limit, 0..1 of it: the mean of max(1 - I / limit, 0) over a normal ln I."""
    sd = jnp.maximum(rays.log_power_sd, LEAST_SD)
    away = (jnp.log(limit) - rays.log_intensity) / sd
    # The value of a put option, to the letter: Black & Scholes 1973. Far above the limit it is 0 times any power.
    relative = jnp.exp(jnp.minimum(jnp.square(sd) / 2 - away * sd, 5.0))
    return jnp.clip(ndtr(away) - relative * ndtr(away - sd), 0.0, 1.0)


EFFECT = Effect(
    name="snr_dropout",
    stage="detection",
    title="weak echoes are lost",
    formula="keep *= σ((ln P − threshold) / width) · (1 − zero_loss · max(1 − I / limit, 0))",
    parameters={
        "threshold": Parameter(-20.0, -20.0, 0.0, "ln P", "log power at which half the echoes are lost", scale=4.0),
        "width": Parameter(0.4, 0.1, 1.5, "nats", "softness of the threshold", scale=0.3),
        "limit": Parameter(0.5, 0.02, 1.0, "", "intensity below which echoes are lost in proportion", scale=0.2),
        "zero_loss": Parameter(0.0, 0.0, 0.99, "", "share lost where the intensity is 0", scale=0.3),
    },
    channels=("drop",),
    signature="One curve of loss over predicted power, or over predicted intensity, holds for all classes, ranges and "
    "angles.",
    covariates=("power", "range"),
    look_alikes={
        "material_dropout": "compare classes at equal power",
        "range_gate": "a gate cuts at one range whatever the power",
        "atmospheric_extinction": "extinction dims the intensity too",
        "specular_lobe": "mirror loss is of vehicles alone",
    },
    source="Kilic et al., Lidar Light Scattering Augmentation (LISA), arXiv 2107.07004, 2021 (echoes below the power "
    "of the longest range are lost); CARLA 0.9.15, RayCastLidar.cpp, 2023 (losses that grow in proportion below an "
    "intensity, https://carla.org/Doxygen/html/df/dec/RayCastLidar_8cpp_source.html)",
    apply=apply,
    starts=(
        *({"threshold": t} for t in (-10.0, -8.0, -7.0, -6.0, -5.0, -4.0, -3.0)),
        *({"zero_loss": 0.5, "limit": limit} for limit in (0.2, 0.5, 0.8)),
    ),
)
