"""A slanted surface stretches the pulse."""

from __future__ import annotations

from jaxsim.effects.edits import misread, tangent
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds half the depth of the beam's footprint, r * divergence * tan θ."""
    return misread(rays, 0.5 * p["divergence_rad"] * rays.range_m * tangent(rays))


EFFECT = Effect(
    name="incidence_range_bias",
    stage="ranging",
    title="slanted surfaces read too far",
    formula="reading += ½ · r · divergence · tan θ",
    parameters={"divergence_rad": Parameter(0.0, 0.0, 0.03, "rad", "opening of the beam", scale=0.002)},
    channels=("range",),
    signature="The range residual is proportional to range times the tangent of the incidence angle.",
    covariates=("incidence", "range"),
    look_alikes={
        "extrinsic_rotation": "on the road both grow as r²; a pitch changes sign from front to rear and spares walls",
        "range_walk": "compare dark and bright classes at one angle",
        "range_scale": "compare walls that face the sensor",
        "beam_elevation_error": "an elevation error has either sign, beam by beam",
    },
    source="Laconte et al., Lidar Measurement Bias Estimation via Return Waveform Modelling, ICRA 2019; Agishev, "
    "Petříček & Zimmermann, Self-Supervised Depth Correction of Lidar Measurements from Map Consistency Loss, arXiv "
    "2303.01123, 2023",
    apply=apply,
    starts=({"divergence_rad": 0.001},),
)
