"""What light, optics and electronics do: one file, one effect; `EFFECTS` lists them in physical order."""

from jaxsim.effects import (
    atmospheric_extinction,
    beam_elevation_error,
    beam_gain,
    beam_range_bias,
    extrinsic_rotation,
    extrinsic_translation,
    incidence_cosine,
    material_dropout,
    motion_distortion,
    oren_nayar,
    random_dropout,
    range_falloff,
    range_scale,
    snr_dropout,
)
from jaxsim.effects.effect import CHANNELS, COVARIATES, STAGES, Effect, Parameter
from jaxsim.effects.rays import Rays, Scan, all_rays, rays_at

EFFECTS: dict[str, Effect] = {
    # geometry
    "extrinsic_rotation": extrinsic_rotation.EFFECT,
    "extrinsic_translation": extrinsic_translation.EFFECT,
    "beam_elevation_error": beam_elevation_error.EFFECT,
    "motion_distortion": motion_distortion.EFFECT,
    # surface
    "incidence_cosine": incidence_cosine.EFFECT,
    "oren_nayar": oren_nayar.EFFECT,
    # path
    "range_falloff": range_falloff.EFFECT,
    "atmospheric_extinction": atmospheric_extinction.EFFECT,
    # receiver
    "beam_gain": beam_gain.EFFECT,
    # detection
    "snr_dropout": snr_dropout.EFFECT,
    "random_dropout": random_dropout.EFFECT,
    "material_dropout": material_dropout.EFFECT,
    # ranging
    "range_scale": range_scale.EFFECT,
    "beam_range_bias": beam_range_bias.EFFECT,
}
"""Every effect by name. Within a stage, too, the order is that of the light and the signal."""


def get_effect(name: str) -> Effect:
    """The effect of that name. Raises ValueError that lists the known names."""
    if name not in EFFECTS:
        raise ValueError(f"no effect named {name!r}; known: {', '.join(EFFECTS)}")
    return EFFECTS[name]


__all__ = [
    "CHANNELS",
    "COVARIATES",
    "EFFECTS",
    "STAGES",
    "Effect",
    "Parameter",
    "Rays",
    "Scan",
    "all_rays",
    "get_effect",
    "rays_at",
]
