"""Two folders of different streets."""

import numpy as np
import pytest

from jaxsim.discover.unpaired.read import roughness_m


def test_noise_of_ranges_is_read_off_planes():
    rng = np.random.default_rng(0)
    azimuth = np.linspace(-0.5, 0.5, 200)
    wall = np.broadcast_to(10 / np.cos(azimuth), (50, 200))
    noisy = wall + rng.normal(0, 0.02, wall.shape)
    assert roughness_m(noisy, np.ones(wall.shape, bool)) == pytest.approx(0.02, rel=0.05)
    assert roughness_m(wall, np.ones(wall.shape, bool)) < 1e-3
