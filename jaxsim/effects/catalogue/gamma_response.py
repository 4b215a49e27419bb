"""The receiver or the firmware maps power to intensity by a power law."""

from __future__ import annotations

from dataclasses import replace

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Raises the reported intensity to the power gamma."""
    return replace(rays, log_intensity=p["gamma"] * rays.log_intensity)


EFFECT = Effect(
    name="gamma_response",
    stage="receiver",
    title="the reported intensity is a power of the received one",
    formula="ln I = gamma · ln I",
    parameters={"gamma": Parameter(1.0, 0.3, 2.0, "", "power; below 1 contrast shrinks", scale=0.2)},
    channels=("intensity",),
    signature="Every contrast, of classes, angles and ranges, shrinks or grows by one factor.",
    covariates=("intensity", "class"),
    look_alikes={
        "incidence_cosine": "a missing cosine leaves the contrast of classes; that needs known reflectances",
        "range_falloff": "falloff leaves the contrast of classes",
        "intensity_offset": "an offset acts on dark surfaces alone",
        "saturation": "saturation acts on bright surfaces alone",
    },
    source="Hesai Pandar64 user manual, appendix D, Nonlinear reflectivity mapping",
    apply=apply,
)
