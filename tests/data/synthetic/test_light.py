"""Maps of shadows."""

import jax.numpy as jnp
import numpy as np

from jaxsim.data.synthetic.light import map_borders, map_place
from jaxsim.data.synthetic.render import SHADOW_CELLS


def test_map_places_invert_map_borders() -> None:
    x, y = map_borders(SHADOW_CELLS)
    centre_x, centre_y = (jnp.asarray(b[10:40], jnp.float32) for b in (x, y))
    row, column = map_place(centre_x, centre_y, SHADOW_CELLS)
    np.testing.assert_allclose(row, np.arange(10, 40) - 0.5, atol=0.01)
    np.testing.assert_allclose(column, np.arange(10, 40) - 0.5, atol=0.01)
