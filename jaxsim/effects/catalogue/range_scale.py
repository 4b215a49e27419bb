"""The clock runs fast or slow."""

from __future__ import annotations

from jaxsim.effects.edits import misread
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds a share of the range to the reading."""
    return misread(rays, p["scale"] * rays.range_m)


EFFECT = Effect(
    name="range_scale",
    stage="ranging",
    title="all ranges are too long or too short by a factor",
    formula="reading += scale · r",
    parameters={"scale": Parameter(0.0, -0.02, 0.02, "", "relative error of range", scale=0.002)},
    channels=("range",),
    signature="The range residual is proportional to range, for all beams, angles and classes.",
    covariates=("range",),
    look_alikes={
        "range_offset": "an offset is there near by too",
        "beam_range_bias": "a bias is constant within a beam",
        "extrinsic_rotation": "a pitch moves the road by r², with opposite signs ahead and behind, and not walls",
        "incidence_range_bias": "it needs an incidence angle: compare walls that face the sensor",
        "range_walk": "compare dark with bright surfaces at equal range",
    },
    source="Glennie & Lichti, Static Calibration and Analysis of the Velodyne HDL-64E S2, Remote Sensing 2(6), 2010 "
    "(distance scale)",
    apply=apply,
)
