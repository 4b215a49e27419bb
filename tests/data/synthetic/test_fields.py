"""Noise that belongs to a place."""

import jax.numpy as jnp
import numpy as np

from jaxsim.data.synthetic import fields
from tests.data.synthetic.made_raycast import slow_noise


def test_noise_is_the_lattice_s_hash_interpolated() -> None:
    points = np.random.default_rng(0).uniform(-50, 50, (200, 3)).astype(np.float32)
    fast = np.asarray(fields.smooth_noise3(*jnp.asarray(points.T)))
    np.testing.assert_allclose(fast, [slow_noise(p.astype(np.float64)) for p in points], atol=1e-5)
    assert abs(fast.mean() - 0.5) < 0.05
