"""Patterns lie where things have them."""

import jax.numpy as jnp
import numpy as np

from jaxsim.data.synthetic.materials import _sign, _wheel


def field(*values):
    return jnp.asarray(values, jnp.float32)[:, None]


def test_a_wheel_has_its_rim_on_the_outer_side_alone():
    axle, radius = 1.3, 0.32
    x = field(axle, axle, -axle, axle + 0.9 * radius)
    p = jnp.stack([x, jnp.zeros_like(x), jnp.full_like(x, radius)])
    aside = field(1.0, 0.0, 1.0, 1.0)
    n = jnp.stack([jnp.zeros_like(x), aside, jnp.zeros_like(x)])
    # The hub from the side and along the tyre, the hub of the other axle, and the tyre's own rubber.
    np.testing.assert_array_equal(
        _wheel(p, n, jnp.stack([jnp.full_like(x, axle), jnp.full_like(x, radius)])).second[:, 0], [1, 0, 1, 0]
    )


def test_a_signs_sheeting_is_on_the_face_that_looks_along_x():
    p = jnp.zeros((3, 2, 1))
    n = jnp.stack([field(1.0, -1.0), field(0.0, 0.0), field(0.0, 0.0)])
    half = jnp.full((3, 2, 1), 0.3)
    marks = _sign(p, n, half, extra=jnp.stack([field(2.0, 2.0), field(0.03, 0.03)]))
    np.testing.assert_array_equal(np.asarray(marks.retro)[:, 0].sum(), 1)
