"""Weak echoes are ranged less exactly."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

# Of an intensity of exp(-2) = 0.14 at 10 m, where power and intensity are one.
LOG_REFERENCE_POWER = -2.0
# Times sd that noise grows to at most: of an echo without power it would have no bound.
_MOST = 50.0


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds Gaussian noise of sd / sqrt(P / P_ref), ln P_ref = -2, to what noise there is."""
    growth = jnp.exp(jnp.minimum(-0.5 * (rays.log_power - LOG_REFERENCE_POWER), jnp.log(_MOST)))
    noise = p["sd_m"] * jnp.where(rays.hit, growth, jnp.zeros_like(growth))
    # The root has no derivative where there was no noise before.
    some = rays.noise_m > 0
    both = jnp.sqrt(jnp.where(some, jnp.square(noise) + jnp.square(rays.noise_m), jnp.ones_like(noise)))
    return replace(rays, noise_m=jnp.where(some, both, noise))


EFFECT = Effect(
    name="range_noise",
    stage="ranging",
    title="ranges of weak echoes are noisy",
    formula="reading += N(0, sd² · P_ref / P),  ln P_ref = −2",
    parameters={"sd_m": Parameter(0.0, 0.0, 0.3, "m", "standard deviation at the reference power", scale=0.02)},
    channels=("range",),
    signature="The spread of the range residual, not its mean, grows as power falls.",
    covariates=("power", "range"),
    look_alikes={
        "mixed_pixels": "mixed readings are off at depth steps alone",
        "range_quantization": "a lattice has an even spread at all powers",
        "range_walk": "a walk moves the mean",
    },
    source="Schmitz et al., How to Efficiently Determine the Range Precision of 3D Terrestrial Laser Scanners, "
    "Sensors 19(6), 2019 (precision follows intensity)",
    apply=apply,
    starts=({"sd_m": 0.003}, {"sd_m": 0.01}, {"sd_m": 0.05}),
)
