"""What sensor.lidar.ray_cast does to rays, in NumPy, from CARLA's published source (RayCastLidar.cpp)."""

import numpy as np

DEFAULTS = {
    "atmosphere_attenuation_rate": 0.004,
    "dropoff_general_rate": 0.0,
    "dropoff_intensity_limit": 0.8,
    "dropoff_zero_intensity": 0.0,
    "noise_stddev": 0.0,
}


def ray_cast(distance_m, rng, **attributes):
    """Range (0 = no return) and intensity of rays that hit at a distance (0 = nothing), as CARLA's sensor reports
    them."""
    a = DEFAULTS | attributes
    hit = distance_m > 0
    cast = rng.random(distance_m.shape) >= a["dropoff_general_rate"]
    intensity = np.exp(-a["atmosphere_attenuation_rate"] * distance_m)
    noisy = distance_m + a["noise_stddev"] * rng.normal(size=distance_m.shape)
    zero, limit = a["dropoff_zero_intensity"], a["dropoff_intensity_limit"]
    stays = (intensity > limit) | (rng.random(distance_m.shape) < zero / limit * intensity + 1 - zero)
    kept = hit & cast & stays
    return np.where(kept, noisy, 0).astype(np.float32), np.where(kept, intensity, 0).astype(np.float32)
