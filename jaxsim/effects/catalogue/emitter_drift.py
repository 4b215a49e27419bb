"""The emitter grows weaker as it warms up or ages."""

from __future__ import annotations

from jaxsim.effects.edits import brighten
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Dims by the rate times the minutes since the scan's first frame."""
    return brighten(rays, -p["rate"] * rays.time_s / 60)


EFFECT = Effect(
    name="emitter_drift",
    stage="receiver",
    title="the emitter grows weaker with time",
    formula="ln I, ln P −= rate · (time − first frame's time)",
    parameters={"rate": Parameter(0.0, -5.0, 5.0, "nats/min", "loss of light a minute", scale=0.1)},
    channels=("intensity",),
    signature="The intensity falls from frame to frame, alike for all ranges, angles and classes.",
    covariates=("frame",),
    needs="time",
    look_alikes={
        "atmospheric_extinction": "thickening fog takes far surfaces first",
        "window_contamination": "dirt is fixed to an azimuth",
        "beam_gain": "compare frames",
    },
    source="Coldren, Corzine & Mašanović, Diode Lasers and Photonic Integrated Circuits, 2nd ed., 2012, chapter 2 "
    "(output power falls as the diode warms up)",
    apply=apply,
)
