"""The sensor is mounted at a slightly different place."""

from __future__ import annotations

from jaxsim.effects.edits import move_sensor
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Starts rays from a displaced origin; the reading is the range from there."""
    return move_sensor(rays, (p["x_m"], p["y_m"], p["z_m"]))


def _shift(meaning: str) -> Parameter:
    return Parameter(0.0, -0.5, 0.5, "m", meaning, scale=0.08)


EFFECT = Effect(
    name="extrinsic_translation",
    stage="geometry",
    title="the sensor is mounted at another place than assumed",
    formula="true origin = nominal origin + (x, y, z)",
    parameters={"x_m": _shift("forward"), "y_m": _shift("to the left"), "z_m": _shift("up")},
    channels=("range", "intensity", "drop"),
    signature="x and y: a range residual that follows the cosine or sine of the azimuth, on surfaces that face the "
    "sensor and at all ranges alike. z: the road's residual is proportional to range.",
    covariates=("azimuth", "range", "step", "row"),
    look_alikes={
        "extrinsic_rotation": "a rotation's residual on the road grows as r²",
        "motion_distortion": "motion changes with speed and place in the scan",
        "range_scale": "a height error moves the road alone; compare walls",
        "beam_range_bias": "a bias is the same all round and on all surfaces",
    },
    source="Levinson & Thrun, Automatic Online Calibration of Cameras and Lasers, RSS 2013 (miscalibration of the "
    "mounting, sudden and gradual)",
    apply=apply,
    of_mounting=True,
    casts=3,
    starts=tuple({axis: way} for axis in ("x_m", "y_m", "z_m") for way in (-0.03, 0.03)),
)
