"""Rays whose covariates are drawn independently of each other."""

from types import SimpleNamespace

import numpy as np


def rays(rng, shape):
    """Host rays of a shape (b, c, r); each block is a frame of its own."""
    return SimpleNamespace(
        range_m=rng.uniform(3, 60, shape),
        incidence_rad=rng.uniform(0, 1.4, shape),
        row=rng.integers(0, 16, shape),
        column=np.broadcast_to(np.arange(shape[1])[None, :, None], shape),
        azimuth_rad=rng.uniform(-3, 3, shape),
        semantic=rng.choice([7, 11, 26], shape),
        log_power=rng.normal(-2, 1, shape),
        log_intensity=rng.normal(-2, 0.5, shape),
        beside_m=rng.uniform(3, 60, (*shape, 4)),
        time_s=np.broadcast_to(np.arange(shape[0])[:, None, None] * 10.0, shape),
        phase=rng.uniform(0, 1, shape),
        speed_mps=np.broadcast_to(np.arange(shape[0])[:, None, None] * 1.0, shape),
        heading_rad=np.broadcast_to(np.arange(shape[0])[:, None, None] * 0.6, shape),
        rgb=rng.uniform(0, 1, (*shape, 3)),
    )
