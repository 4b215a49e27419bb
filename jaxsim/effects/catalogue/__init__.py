"""The catalogue of effects, and nothing else: a file an effect, named like it, that ends in `EFFECT`.

A file holds the formula (`apply`), the parameters with bounds and priors, and what the page says: title, formula,
signature, look-alikes, source. `EFFECTS` lists them in physical order, which is the order in which they act.
CONTRIBUTING.md shows how to add one.
"""

from jaxsim.effects.catalogue import (
    ambient_light,
    atmospheric_extinction,
    beam_azimuth_error,
    beam_dropout,
    beam_elevation_error,
    beam_gain,
    beam_range_bias,
    blooming,
    cyclic_range_error,
    edge_dropout,
    emitter_drift,
    extrinsic_rotation,
    extrinsic_translation,
    focal_compensation,
    fog_backscatter,
    gamma_response,
    incidence_cosine,
    incidence_range_bias,
    intensity_offset,
    intensity_quantization,
    interference,
    material_dropout,
    mixed_pixels,
    motion_distortion,
    near_range_overlap,
    oren_nayar,
    packet_loss,
    precipitation_clutter,
    random_dropout,
    range_falloff,
    range_gate,
    range_noise,
    range_offset,
    range_quantization,
    range_scale,
    range_walk,
    retroreflection,
    saturation,
    sector_occlusion,
    snr_dropout,
    specular_lobe,
    window_contamination,
)
from jaxsim.effects.effect import Effect
from jaxsim.files import guess

EFFECTS: dict[str, Effect] = {
    # geometry
    "extrinsic_rotation": extrinsic_rotation.EFFECT,
    "extrinsic_translation": extrinsic_translation.EFFECT,
    "beam_elevation_error": beam_elevation_error.EFFECT,
    "beam_azimuth_error": beam_azimuth_error.EFFECT,
    "motion_distortion": motion_distortion.EFFECT,
    # surface
    "incidence_cosine": incidence_cosine.EFFECT,
    "oren_nayar": oren_nayar.EFFECT,
    "specular_lobe": specular_lobe.EFFECT,
    "retroreflection": retroreflection.EFFECT,
    # path
    "range_falloff": range_falloff.EFFECT,
    "atmospheric_extinction": atmospheric_extinction.EFFECT,
    "near_range_overlap": near_range_overlap.EFFECT,
    "window_contamination": window_contamination.EFFECT,
    "blooming": blooming.EFFECT,
    "fog_backscatter": fog_backscatter.EFFECT,
    "precipitation_clutter": precipitation_clutter.EFFECT,
    "interference": interference.EFFECT,
    # receiver
    "focal_compensation": focal_compensation.EFFECT,
    "beam_gain": beam_gain.EFFECT,
    "emitter_drift": emitter_drift.EFFECT,
    "gamma_response": gamma_response.EFFECT,
    "intensity_offset": intensity_offset.EFFECT,
    "saturation": saturation.EFFECT,
    "intensity_quantization": intensity_quantization.EFFECT,
    # detection
    "snr_dropout": snr_dropout.EFFECT,
    "random_dropout": random_dropout.EFFECT,
    "material_dropout": material_dropout.EFFECT,
    "beam_dropout": beam_dropout.EFFECT,
    "edge_dropout": edge_dropout.EFFECT,
    "range_gate": range_gate.EFFECT,
    "sector_occlusion": sector_occlusion.EFFECT,
    "packet_loss": packet_loss.EFFECT,
    "ambient_light": ambient_light.EFFECT,
    # ranging
    "range_noise": range_noise.EFFECT,
    "range_walk": range_walk.EFFECT,
    "incidence_range_bias": incidence_range_bias.EFFECT,
    "range_scale": range_scale.EFFECT,
    "range_offset": range_offset.EFFECT,
    "cyclic_range_error": cyclic_range_error.EFFECT,
    "beam_range_bias": beam_range_bias.EFFECT,
    "mixed_pixels": mixed_pixels.EFFECT,
    "range_quantization": range_quantization.EFFECT,
}
"""Every effect by name. Within a stage, too, the order is that of the light and the signal. Effects of one's own join
it, each at the end of its stage (`own.known_effects`)."""


def get_effect(name: str) -> Effect:
    """The effect of that name. Raises ValueError that lists the known names."""
    if name not in EFFECTS:
        raise ValueError(
            f"no effect named {name!r}{guess(name, EFFECTS)} One of your own needs --effects-from FILE.py, or its "
            f"package installed. Known: {', '.join(EFFECTS)}"
        )
    return EFFECTS[name]
