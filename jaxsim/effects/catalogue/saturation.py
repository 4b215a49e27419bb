"""The receiver clips strong echoes, or bends them over."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

_LEAST = 1e-4
"""Compressions are kept above this before their logarithm is taken: none is felt there."""


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Bends bright intensities over, and ends the reported ones at the ceiling; at a ceiling of 1 nothing is cut that
    the report does not cut."""
    # An amplifier bends before it clips, and its noise comes on top of what it bent; a report clips noise and all.
    over = rays.log_intensity + jnp.log(jnp.maximum(p["compression"], _LEAST))
    power = 2 * p["sharpness"]
    bent = rays.log_intensity - jax.nn.softplus(power * over) / power
    cut = jnp.minimum(bent, jnp.log(p["ceiling"]))
    return replace(
        rays,
        log_intensity=jnp.where(p["ceiling"] < 1, cut, bent),
        intensity_top=jnp.minimum(rays.intensity_top, p["ceiling"]),
    )


EFFECT = Effect(
    name="saturation",
    stage="receiver",
    title="the intensity ends at a ceiling, or bends towards one",
    formula="I = min(I / (1 + (compression · I)^(2 sharpness))^(1 / (2 sharpness)), ceiling)",
    parameters={
        "ceiling": Parameter(1.0, 0.1, 1.0, "", "largest intensity reported", scale=0.3),
        "compression": Parameter(0.0, 0.0, 20.0, "", "1 / the intensity that the receiver bends towards", scale=1.5),
        "sharpness": Parameter(1.0, 0.5, 10.0, "", "of the bend: at 0.5 it is soft, at 10 nearly a corner", scale=2.0),
    },
    channels=("intensity",),
    signature="Intensities pile up at one value, or below it; bright classes alone lose their contrast.",
    covariates=("intensity",),
    of_recording=True,
    look_alikes={
        "gamma_response": "gamma bends dark surfaces too and piles nothing up",
        "retroreflection": "compare white paint with signs",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix E (maximum "
    "intensity of each laser, codes end at 255); Rapp, Effects of HPA-Nonlinearity on a 4-DPSK/OFDM-Signal for a "
    "Digital Sound Broadcasting System, 2nd European Conference on Satellite Communications, 1991 (the bend of an "
    "amplifier)",
    apply=apply,
    starts=(
        *({"ceiling": level} for level in (0.9, 0.7, 0.5, 0.35, 0.2)),
        *({"compression": 1 / level, "sharpness": 5.0} for level in (0.9, 0.7, 0.5, 0.35, 0.2)),
        *({"compression": 1 / level} for level in (0.8, 0.4, 0.2)),
    ),
)
