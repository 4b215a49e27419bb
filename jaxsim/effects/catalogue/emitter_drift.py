"""The emitter grows weaker as it warms up or ages."""

from __future__ import annotations

from jaxsim.effects.edits import brighten
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays, Scan


def apply(p: dict[str, Array], rays: Rays, scan: Scan) -> Rays:
    """Dims by the rate times the minutes since the scan's first frame."""
    return brighten(rays, -p["rate"] * rays.time_s / 60)


EFFECT = Effect(
    name="emitter_drift",
    stage="receiver",
    title="the emitter grows weaker with time",
    formula="ln I, ln P −= rate · (time − first frame's time)",
    parameters={"rate": Parameter(0.0, -5.0, 5.0, "nats/min", "loss of light a minute", scale=0.1)},
    channels=("intensity",),
    betrays="The intensity falls from frame to frame, alike for all ranges, angles and classes.",
    covariates=("frame",),
    look_alikes={
        "atmospheric_extinction": "thickening fog takes far surfaces first",
        "window_contamination": "dirt is fixed to an azimuth",
        "beam_gain": "compare frames",
    },
    source="warm-up over minutes; ageing 1..10 % in 1000 h",
    apply=apply,
)
