"""Each beam has its own gain."""

from __future__ import annotations

from jaxsim.effects.edits import brighten
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Multiplies power and intensity by exp(gain) of the ray's beam."""
    return brighten(rays, p["gain"][rays.row])


EFFECT = Effect(
    name="beam_gain",
    stage="receiver",
    title="each beam has its own gain",
    formula="ln I, ln P += gain[row]",
    parameters={
        "gain": Parameter(0.0, -1.0, 1.0, "nats", "logarithm of each beam's gain", scale=0.12, shape="row"),
    },
    channels=("intensity",),
    signature="Stripes along rows that are the same for all ranges, angles and classes.",
    covariates=("row",),
    look_alikes={
        "focal_compensation": "follow one beam over range: a gain stays, a focal compensation has its minimum at the "
        "beam's focal distance",
        "range_falloff": "on flat ground a row is a range; compare beams on walls and cars, at equal range",
        "incidence_cosine": "on flat ground a row is an angle; compare beams on walls and cars",
        "intensity_offset": "compare dark with bright classes: a gain scales both alike",
    },
    source="Levinson & Thrun, Unsupervised Calibration for Multi-beam Lasers, ISER 2010; Steder et al., Maximum "
    "Likelihood Remission Calibration for Groups of Heterogeneous Laser Scanners, ICRA 2015",
    apply=apply,
)
