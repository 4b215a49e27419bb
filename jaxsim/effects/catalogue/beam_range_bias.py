"""Each beam's clock or optics add their own length."""

from __future__ import annotations

from jaxsim.effects.edits import misread
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds the beam's bias to the reading."""
    return misread(rays, p["bias_m"][rays.row])


EFFECT = Effect(
    name="beam_range_bias",
    stage="ranging",
    title="each beam reads too far or too near by its own constant",
    formula="reading += bias[row]",
    parameters={"bias_m": Parameter(0.0, -0.3, 0.3, "m", "each beam's error", scale=0.04, shape="row")},
    channels=("range",),
    signature="The mean range residual differs by row and is constant over range.",
    covariates=("row",),
    look_alikes={
        "beam_elevation_error": "a wrong elevation grows as r² on the road and leaves walls where they are",
        "range_offset": "an offset is the same for all beams",
        "range_scale": "compare ranges within a beam: a scale grows with range",
        "extrinsic_rotation": "a pitch has opposite signs ahead and behind",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix E (far "
    "distance correction); Glennie & Lichti, Static Calibration and Analysis of the Velodyne HDL-64E S2, Remote "
    "Sensing 2(6), 2010 (each laser's distance offset)",
    apply=apply,
)
