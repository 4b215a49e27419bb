"""What sensor.lidar.ray_cast does to rays, in NumPy, from CARLA's published source (RayCastLidar.cpp).

Source: https://carla.org/Doxygen/html/df/dec/RayCastLidar_8cpp_source.html
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

DEFAULTS = {
    "atmosphere_attenuation_rate": 0.004,
    "dropoff_general_rate": 0.0,
    "dropoff_intensity_limit": 0.8,
    "dropoff_zero_intensity": 0.0,
    "noise_stddev": 0.0,
    "range": 120.0,
}
"""CARLA's own, but for drop-off, which is off as docs/bring-yours.md asks for, and a range of 120 m."""


def ray_cast(distance_m: np.ndarray, rng: np.random.Generator, **attributes: float) -> tuple[np.ndarray, np.ndarray]:
    """Range (m, 0 = no return) and intensity of rays that hit at a distance (m, 0 = nothing), as CARLA's sensor reports
    them, in the distances' shape."""
    a = DEFAULTS | attributes
    hit = (distance_m > 0) & (distance_m <= a["range"])
    cast = rng.random(distance_m.shape) >= a["dropoff_general_rate"]
    intensity = np.exp(-a["atmosphere_attenuation_rate"] * distance_m)
    noisy = distance_m + a["noise_stddev"] * rng.normal(size=distance_m.shape)
    zero, limit = a["dropoff_zero_intensity"], a["dropoff_intensity_limit"]
    stays = (intensity > limit) | (rng.random(distance_m.shape) < zero / limit * intensity + 1 - zero)
    kept = hit & cast & stays
    return np.where(kept, noisy, 0).astype(np.float32), np.where(kept, intensity, 0).astype(np.float32)


def hidden_attributes(seed: int) -> Mapping[str, float]:
    """Attributes that a seed hides: each of attenuation, random losses, losses of faint returns, noise and reach is at
    CARLA's default, as DEFAULTS has it, in a third of the seeds."""
    rng = np.random.default_rng([seed, 1])
    drawn = {
        "atmosphere_attenuation_rate": float(np.exp(rng.uniform(np.log(0.008), np.log(0.04)))),
        "dropoff_general_rate": float(rng.uniform(0.1, 0.5)),
        "noise_stddev": float(np.exp(rng.uniform(np.log(0.01), np.log(0.1)))),
        "range": float(rng.uniform(30, 70)),
    }
    faint = {
        "dropoff_intensity_limit": float(rng.uniform(0.5, 0.95)),
        "dropoff_zero_intensity": float(rng.uniform(0.3, 0.9)),
    }
    kept = {name: value for name, value in drawn.items() if rng.random() > 1 / 3}
    return kept | (faint if rng.random() > 1 / 3 else {})
