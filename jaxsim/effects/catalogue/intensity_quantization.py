"""The intensity is reported in steps."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays, Scan


def apply(p: dict[str, Array], rays: Rays, scan: Scan) -> Rays:
    """Sets the step to which intensities are rounded when they are drawn."""
    return replace(rays, intensity_step=jnp.maximum(rays.intensity_step, p["step"]))


EFFECT = Effect(
    name="intensity_quantization",
    stage="receiver",
    title="the intensity is reported in steps",
    formula="I rounds to multiples of step",
    parameters={"step": Parameter(0.0, 0.0, 0.1, "", "smallest difference of two intensities", scale=0.02)},
    channels=("intensity",),
    betrays="Intensities lie on a lattice.",
    covariates=("intensity",),
    look_alikes={
        "saturation": "a ceiling is one value, a lattice many",
        "intensity_offset": "look for gaps between the values that occur",
    },
    source="integer codes, or hundredths as in KITTI",
    apply=apply,
    starts=tuple({"step": s} for s in (1 / 255, 0.01, 0.02, 0.05)),
)
