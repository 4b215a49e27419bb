"""Air, haze or fog absorb and scatter light on the way out and back."""

from __future__ import annotations

from jaxsim.effects.edits import brighten
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Dims power and intensity by exp(-2 α r) (Beer and Lambert, two ways)."""
    return brighten(rays, -2 * p["coefficient_per_m"] * rays.range_m)


EFFECT = Effect(
    name="atmospheric_extinction",
    stage="path",
    title="haze or fog dims the light on its way",
    formula="ln I, ln P −= 2 α r",
    opposite="below 0: the simulator has haze that the street had not",
    parameters={
        "coefficient_per_m": Parameter(
            0.0,
            -0.02,
            0.05,
            "1/m",
            "extinction α, ln 20 / visibility; negative undoes haze that a simulator has",
            scale=0.004,
        ),
    },
    channels=("intensity",),
    signature="A straight line of the log intensity over range, common to all beams and classes; far surfaces are lost "
    "first.",
    covariates=("range",),
    look_alikes={
        "range_falloff": "falloff is straight over ln r: look beyond 60 m and below 5 m",
        "focal_compensation": "a compensation differs from beam to beam",
        "window_contamination": "a dirty window is fixed to an azimuth and the same at all ranges",
        "emitter_drift": "drift grows with time, whatever the range",
    },
    source="Hahner et al., Fog Simulation on Real LiDAR Point Clouds, ICCV 2021 (two-way transmission, extinction "
    "0.005 to 0.2 1/m); Koschmieder, Theorie der horizontalen Sichtweite, 1924 (ln 20 / visibility)",
    apply=apply,
    starts=({"coefficient_per_m": 0.002}, {"coefficient_per_m": -0.002}),
)
