"""Noise that belongs to a place, and work by blocks of rays."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.data.synthetic import fields
from tests.data.synthetic.made_raycast import slow_noise


def test_noise_is_the_lattice_s_hash_interpolated() -> None:
    points = np.random.default_rng(0).uniform(-50, 50, (200, 3)).astype(np.float32)
    fast = np.asarray(fields.smooth_noise3(*jnp.asarray(points.T)))
    np.testing.assert_allclose(fast, [slow_noise(p.astype(np.float64)) for p in points], atol=1e-5)
    assert abs(fast.mean() - 0.5) < 0.05


@pytest.mark.parametrize("shape", [(3, 5), (70, 90), (1, fields.BLOCK)])
def test_work_by_blocks_is_work_on_all_rays(shape: tuple[int, int]) -> None:
    x = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    seen = {"x": x, "deep": (x > 0, 2 * x)}

    def work(block: dict) -> tuple:
        return block["x"] + 1, jnp.where(block["deep"][0], block["deep"][1], 0.0)

    done = fields.in_blocks(work, jax.tree.map(jnp.asarray, seen))
    np.testing.assert_array_equal(done[0], x + 1)
    np.testing.assert_array_equal(done[1], np.where(x > 0, 2 * x, 0))


def test_what_no_ray_asks_for_is_not_worked_out() -> None:
    x = jnp.arange(6, dtype=jnp.float32)
    asked = fields.when(x > 4, lambda x: (x + 1, x > 2), x)
    np.testing.assert_array_equal(asked[0], np.arange(6) + 1)
    np.testing.assert_array_equal(asked[1], np.arange(6) > 2)
    nothing = fields.when(x > 9, lambda x: (x + 1, x > 2), x)
    np.testing.assert_array_equal(nothing[0], np.zeros(6))
    assert nothing[1].dtype == bool
    assert not nothing[1].any()
