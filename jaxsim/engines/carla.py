"""CARLA's sensor.lidar.ray_cast.

Its law, of the server's source: intensity exp(-a d) with a = atmosphere_attenuation_rate and d the distance, whatever
the surface; a ray is not cast with probability dropoff_general_rate; a return whose intensity I is under
dropoff_intensity_limit stays with probability 1 - z (1 - I / limit), z = dropoff_zero_intensity; Gaussian noise of
noise_stddev along the ray, the same for all.

Sources: https://carla.readthedocs.io/en/latest/ref_sensors/#lidar-sensor and RayCastLidar.cpp,
https://carla.org/Doxygen/html/df/dec/RayCastLidar_8cpp_source.html
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.effects import EFFECTS
from jaxsim.effects.rays import REFERENCE_M
from jaxsim.engines.engine import (
    OF_SURFACES,
    Engine,
    Estimate,
    Estimates,
    Setting,
    any_loss,
    combined,
    degrees,
    known,
    root_of_squares,
)

_SURFACE = (
    "its intensity is exp(-rate · distance) whatever the surface; apply it behind the sensor, to "
    "sensor.lidar.ray_cast_semantic, which gives class and incidence of every ray"
)
INSTEAD = {
    **dict.fromkeys(OF_SURFACES, _SURFACE),
    "range_falloff": "it has no power law of range; an attenuation rate follows one only over a short stretch: apply "
    "it behind the sensor",
    "beam_gain": "all channels are alike; apply a gain by channel (points come channel by channel) behind the sensor",
    "motion_distortion": "all rays of a tick start from one place: let fixed_delta_seconds be a fraction of a turn, so "
    "that each tick casts a sector from where the sensor then is",
    "beam_azimuth_error": "all channels of a moment point to one azimuth; several sensors of few channels, "
    "each turned by its own error, come nearer",
    "beam_elevation_error": "channels lie evenly between lower_fov and upper_fov; several sensors of few channels, "
    "each with its own field of view, come nearer",
    "range_noise": "noise_stddev is the same for all echoes; it is set to the noise at the reference power",
}


def settings(answer: Estimates, now: Mapping[str, float]) -> list[Setting]:
    """CARLA's attributes, `now` what they are in the frames that were compared."""
    was = now["atmosphere_attenuation_rate"]
    extinction = answer.one("atmospheric_extinction", "coefficient_per_m")
    # ln I falls by 2 α r in our law, by a d in CARLA's, whose air is never clearer than clear.
    rate = extinction and extinction.mapped(lambda alpha: max(was + 2 * alpha, 0.0))
    noise = answer.range_noise and answer.range_noise.mapped(lambda sd: root_of_squares((now["noise_stddev"], sd)))
    why = f"atmospheric_extinction: {was:g} as it was, and 2 α"
    if extinction and was + 2 * extinction.value < 0:
        why += ", which is less than none: what is left of it is to be added behind"
    return [
        *known(("atmosphere_attenuation_rate", rate, "1/m", why)),
        *losses(answer, now, rate=rate.value if rate else was),
        *known(("noise_stddev", noise, "m", "noise of the range")),
        *mounting(answer),
    ]


LOSS_RANGES_M = np.geomspace(2.0, 120.0, 80)
"""Distances at which losses are held against CARLA's: as many in each stretch as rays of a street are, about."""
LEAST_LOSS = 0.01
"""Share of rays that a threshold on the power may lose within LOSS_RANGES_M and still count as none."""


def losses(answer: Estimates, now: Mapping[str, float], *, rate: float) -> list[Setting]:
    """Drop-off and reach that lose as many rays at each distance as the answer, with an attenuation of `rate`.

    CARLA loses every class alike: of `material_dropout` it takes the mean over classes that lose. `snr_dropout` has
    CARLA's own losses among its forms; of its other form, a threshold on the power, CARLA's echoes make one on
    distance: a cut, or losses by intensity, whichever comes nearer over LOSS_RANGES_M (least squares).
    """
    # A sensor.json has the neutral 0 for classes that no ray showed.
    of_classes = mean_by_certainty([p for p in answer.each("material_dropout", "probability") if p.value])
    even = combined(
        answer.one("random_dropout", "probability"), of_classes, answer.levels.get("random_loss"), how=any_loss
    )
    reach, why_reach = answer.limit("maximum_m"), "range_gate: nothing returns from beyond"
    faint = faint_losses(answer, rate=rate)
    if faint.reach is not None and (reach is None or faint.reach.value < reach.value):
        reach, why_reach = faint.reach, faint.why
    if faint.general is not None:
        even = combined(even, faint.general, how=any_loss)
    rate_of_all = even and even.mapped(lambda p: any_loss((now["dropoff_general_rate"], p)))
    return known(
        ("dropoff_general_rate", rate_of_all, "", "rays lost, every ray alike"),
        *((name, value, "", faint.why) for name, value in faint.drop_off.items()),
        ("range", reach, "m", why_reach),
    )


class Faint(NamedTuple):
    """Losses of faint echoes in CARLA's words."""

    why: str = ""
    drop_off: Mapping[str, Estimate] = {}
    """Values of its attributes of drop-off by intensity."""
    general: Estimate | None = None
    """Losses of every ray alike that come with them."""
    reach: Estimate | None = None
    """A longest range in their place, m."""


def faint_losses(answer: Estimates, *, rate: float) -> Faint:
    """What `snr_dropout` says: CARLA's own losses, those of CARLA's that come nearest, or a cut where that comes
    nearer."""
    if "snr_dropout" not in answer.effects:
        return Faint()
    # What sensor.json does not give is neutral.
    given = {
        name: answer.one("snr_dropout", name) or Estimate(p.neutral)
        for name, p in EFFECTS["snr_dropout"].parameters.items()
    }
    threshold, width = given["threshold"], given["width"]
    limit, zero = given["limit"], given["zero_loss"]
    # ln of the power that the effect sees: the reported intensity over the square of the distance.
    intensity = np.exp(-rate * LOSS_RANGES_M)
    log_power = np.log(intensity) - 2 * np.log(LOSS_RANGES_M / REFERENCE_M)
    strong = 1 / (1 + np.exp(-(log_power - threshold.value) / width.value))
    if zero.value > 0 and strong.min() > 1 - LEAST_LOSS:
        drop_off = {"dropoff_intensity_limit": limit, "dropoff_zero_intensity": zero}
        return Faint("snr_dropout: its form below an intensity is CARLA's own", drop_off)
    kept = strong * (1 - zero.value * np.maximum(1 - intensity / limit.value, 0))
    cut = threshold.mapped(lambda power: float(np.interp(-power, -log_power, LOSS_RANGES_M)))
    nearest = nearest_drop_off(1 - kept, intensity)
    if float(np.sum(((cut.value >= LOSS_RANGES_M) - kept) ** 2)) < nearest.off:
        return Faint("snr_dropout: of CARLA's echoes, whose power is one of distance, this cut", reach=cut)
    drop_off = {"dropoff_intensity_limit": Estimate(nearest.limit), "dropoff_zero_intensity": Estimate(nearest.zero)}
    general = Estimate(nearest.general, nearest.general, nearest.general)
    return Faint("snr_dropout: CARLA's own losses that come nearest to it over 2 to 120 m", drop_off, general)


class DropOff(NamedTuple):
    """CARLA's losses: 1 - (1 - general)(1 - zero max(1 - I / limit, 0))."""

    off: float
    """Sum of squares by which they miss what was asked for."""
    general: float
    limit: float
    zero: float


def mean_by_certainty(values: Sequence[Estimate]) -> Estimate | None:
    """The mean of numbers that are surely above 0 (classes that no ray showed are not), each weighted by the inverse
    square of its interval's width; of all alike where none is. None where there is no number."""
    if not values:
        return None
    values = [value for value in values if value.low > 0] or values
    widths = np.array([value.high - value.low for value in values])
    weight = 1 / np.maximum(np.where(np.isfinite(widths), widths, 1.0), 1e-6) ** 2
    return Estimate(*(float(np.average([value[k] for value in values], weights=weight)) for k in range(3)))


def nearest_drop_off(lost: Float[np.ndarray, " n"], intensity: Float[np.ndarray, " n"]) -> DropOff:
    """The losses that are nearest to `lost` at these intensities, by least squares."""
    tried = []
    for limit in np.linspace(0.02, 1.0, 50):
        faint = np.maximum(1 - intensity / limit, 0.0)
        # What is kept, a - b faint, is linear in a = 1 - general and b = a zero.
        design = np.stack([np.ones_like(faint), -faint], axis=1)
        a, b = np.linalg.lstsq(design, 1 - lost, rcond=None)[0]
        zero = float(np.clip(b / a, 0.0, 1.0)) if a > 0 else 0.0
        # Where one of the two lies at its bound the other is fitted beside it.
        share = 1 - zero * faint
        a = float(np.clip(share @ (1 - lost) / (share @ share), 1e-3, 1.0))
        off = float(np.sum((a * (1 - zero * faint) - (1 - lost)) ** 2))
        tried.append(DropOff(off, 1 - a, float(limit), zero))
    return min(tried)


def mounting(answer: Estimates) -> list[Setting]:
    """The change of the sensor's transform, in CARLA's axes (y to the right, pitch up, yaw clockwise)."""
    names = {
        ("extrinsic_translation", "x_m"): ("x", 1, "m"),
        ("extrinsic_translation", "y_m"): ("y", -1, "m"),
        ("extrinsic_translation", "z_m"): ("z", 1, "m"),
        ("extrinsic_rotation", "roll_rad"): ("roll", 1, "degrees"),
        ("extrinsic_rotation", "pitch_rad"): ("pitch", -1, "degrees"),
        ("extrinsic_rotation", "yaw_rad"): ("yaw", -1, "degrees"),
    }
    attributes = []
    for (effect, parameter), (name, sign, unit) in names.items():
        value = answer.one(effect, parameter)
        if value is not None:
            changed = degrees(value, sign) if unit == "degrees" else value.mapped(lambda v, sign=sign: sign * v)
            attributes.append(
                Setting(f"transform.{name}", changed, unit, f"{effect}: add it to the sensor's transform")
            )
    return attributes


def text(chosen: Sequence[Setting]) -> str:
    """A JSON object of attributes for `blueprint.set_attribute`, and the change of the transform."""
    # CARLA takes texts.
    attributes = {o.name: f"{o.value.value:.6g}" for o in chosen if not o.name.startswith("transform.")}
    change = {
        one.name.removeprefix("transform."): one.value.value for one in chosen if one.name.startswith("transform.")
    }
    return json.dumps(
        {"blueprint": "sensor.lidar.ray_cast", "attributes": attributes, "add_to_transform": change}, indent=1
    )


ENGINE = Engine(
    title="CARLA",
    settings=settings,
    expresses=frozenset(
        {
            "atmospheric_extinction",
            "random_dropout",
            "random_loss",
            "material_dropout",
            "snr_dropout",
            "range_noise",
            "range_gate",
            "extrinsic_rotation",
            "extrinsic_translation",
        }
    ),
    instead=INSTEAD,
    text=text,
    suffix=".json",
    notes=(
        "The frames that were compared should be CARLA's with dropoff_general_rate 0, dropoff_zero_intensity 0 and "
        "noise_stddev 0: what a simulator drops shows no surface, and nothing can be told of it. What is not written "
        "stays as it was in them: CARLA's default dropoff_zero_intensity of 0.4 would drop far returns on top.",
        "Values that CARLA has now are given with --now; else its defaults are taken, with drop-off and noise off.",
    ),
    links=(
        "https://carla.readthedocs.io/en/latest/ref_sensors/#lidar-sensor",
        "https://carla.org/Doxygen/html/df/dec/RayCastLidar_8cpp_source.html",
    ),
    defaults={"atmosphere_attenuation_rate": 0.004, "dropoff_general_rate": 0.0, "noise_stddev": 0.0},
    nearest="its rays begin at the sensor; drop points that lie nearer behind it",
)
