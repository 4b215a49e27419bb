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

from jaxsim.engines.answer import Answer, Engine, Estimate, Setting, any_loss, degrees, root_of_squares, together

_SURFACE = (
    "its intensity is exp(-rate · distance) whatever the surface; apply it behind the sensor, to "
    "sensor.lidar.ray_cast_semantic, which gives class and incidence of every ray"
)
INSTEAD = {
    "incidence_cosine": _SURFACE,
    "oren_nayar": _SURFACE,
    "specular_lobe": _SURFACE,
    "retroreflection": _SURFACE,
    "material_dropout": "drop-off knows intensity alone, and that knows distance alone; drop by class behind "
    "sensor.lidar.ray_cast_semantic",
    "range_falloff": "it has no power law of range; an attenuation rate follows one only over a short stretch: apply "
    "it behind the sensor",
    "snr_dropout": "dropoff_intensity_limit and dropoff_zero_intensity make losses that grow evenly with distance, for "
    "dark and bright surfaces alike; a threshold on the echo's power needs the surface: apply it behind the sensor",
    "beam_gain": "all channels are alike; apply a gain by channel (points come channel by channel) behind the sensor",
    "motion_distortion": "all rays of a tick start from one place: let fixed_delta_seconds be a fraction of a turn, so "
    "that each tick casts a sector from where the sensor then is",
    "beam_elevation_error": "channels lie evenly between lower_fov and upper_fov; several sensors of few channels, "
    "each with its own field of view, come nearer",
    "range_noise": "noise_stddev is the same for all echoes; it is set to the noise at the reference power",
}


def settings(answer: Answer, now: Mapping[str, float]) -> list[Setting]:
    """CARLA's attributes, `now` what they are in the frames that were compared."""
    told: list[Setting] = []
    extinction = answer.one("atmospheric_extinction", "coefficient_per_m")
    if extinction is not None:
        # ln I falls by 2 α r in our law, by a d in CARLA's.
        rate = extinction.mapped(lambda alpha: now["atmosphere_attenuation_rate"] + 2 * alpha)
        why = f"atmospheric_extinction: {now['atmosphere_attenuation_rate']:g} as it was, and 2 α"
        told.append(Setting("atmosphere_attenuation_rate", rate, "1/m", why))
    loss = together(answer.one("random_dropout", "probability"), answer.levels.get("random_loss"), how=any_loss)
    if loss is not None:
        was = now["dropoff_general_rate"]
        told.append(
            Setting("dropoff_general_rate", loss.mapped(lambda p: any_loss((was, p))), "", "rays lost, every ray alike")
        )
    noise = answer.range_noise
    if noise is not None:
        was = now["noise_stddev"]
        both = noise.mapped(lambda sd: root_of_squares((was, sd)))
        told.append(Setting("noise_stddev", both, "m", "noise of the range"))
    reach = answer.one("range_gate", "maximum_m")
    if reach is not None:
        told.append(Setting("range", reach, "m", "range_gate: nothing returns from beyond"))
    return told + mounting(answer)


def mounting(answer: Answer) -> list[Setting]:
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
    attributes = {one.name: _plain(one.value) for one in chosen if not one.name.startswith("transform.")}
    change = {
        one.name.removeprefix("transform."): one.value.value for one in chosen if one.name.startswith("transform.")
    }
    return json.dumps(
        {"blueprint": "sensor.lidar.ray_cast", "attributes": attributes, "add_to_transform": change}, indent=1
    )


def _plain(value: Estimate) -> str:
    """CARLA takes texts."""
    return f"{value.value:.6g}"


ENGINE = Engine(
    title="CARLA",
    settings=settings,
    expresses=frozenset(
        {
            "atmospheric_extinction",
            "random_dropout",
            "random_loss",
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
        "noise_stddev 0: what a simulator drops shows no surface, and nothing can be told of it. Leave "
        "dropoff_zero_intensity 0 afterwards: its default 0.4 drops far returns on top.",
        "Values that CARLA has now are given with --now; else its defaults are taken, with drop-off and noise off.",
    ),
    links=(
        "https://carla.readthedocs.io/en/latest/ref_sensors/#lidar-sensor",
        "https://carla.org/Doxygen/html/df/dec/RayCastLidar_8cpp_source.html",
    ),
    defaults={"atmosphere_attenuation_rate": 0.004, "dropoff_general_rate": 0.0, "noise_stddev": 0.0},
)
