"""What tests of beams are made of."""

import numpy as np

from jaxsim.geometry.sensor import preset


def cloud(name: str, *, firings: int = 200, seed: int = 0):
    """Points of a preset among walls at random distances, with the rings that they are of."""
    spec, rng = preset(name), np.random.default_rng(seed)
    azimuth = np.linspace(np.pi, -np.pi, firings, endpoint=False)[:, None]
    rho = rng.uniform(3, 60, (firings, spec.rows))
    z = spec.origin_m + rho * np.tan(spec.elevation_rad)
    xyz = np.stack([rho * np.cos(azimuth), rho * np.sin(azimuth), z], axis=-1)
    return xyz.reshape(-1, 3).astype("f4"), np.tile(np.arange(spec.rows), firings), spec
