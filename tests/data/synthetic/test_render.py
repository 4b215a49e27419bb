"""Shadows of a scene."""

import jax.numpy as jnp
import numpy as np

from jaxsim.data.synthetic.light import Light, lit
from jaxsim.data.synthetic.raycast import TileSolids
from jaxsim.data.synthetic.render import COVER_CELLS, SHADOW_CELLS, cast_shadows
from jaxsim.data.synthetic.solids import Look, Model, Thing, gather_solids, in_world, poses_at
from jaxsim.data.synthetic.tiles import solids_by_tile


def everything(cells: tuple[int, int], counts: tuple[int, int, int]) -> TileSolids:
    return solids_by_tile(np.ones((cells[0] // 32, cells[1] // 32, sum(counts)), bool), counts)


def test_a_wall_keeps_the_sun_off_the_ground_behind_it() -> None:
    model = Model()
    model.box((-0.1, -4.0, 0.0), (0.1, 4.0, 3.0), Look(11, (0.5, 0.5, 0.5), 0.4))
    things = [Thing(model, 10.0, 0.0)]
    parts = gather_solids(things)
    solids, _ = in_world(parts, *poses_at(things, 0.0, 0.0), instance=np.zeros(1, np.int64))
    # The sun stands 45 degrees high ahead: the wall's shadow lies 3 m long on the near side.
    sun = np.array([1.0, 0.0, 1.0], np.float32) / np.float32(np.sqrt(2))
    lists = {
        "sunward": everything(SHADOW_CELLS, parts.counts),
        "upward": everything(COVER_CELLS, parts.counts),
    }
    shadows = cast_shadows(solids, sun, np.zeros(2, np.float32), **lists)
    rgb, number = np.ones(3, np.float32), np.float32(1.0)
    light = Light(sun, rgb, rgb, rgb, number, number, number, number)
    x = jnp.asarray([6.0, 7.4, 8.0, 9.5, 10.5, 12.0], jnp.float32)
    at, up = (x, 0 * x, 0 * x), (0 * x, 0 * x, jnp.ones_like(x))
    np.testing.assert_allclose(lit(shadows, light, at, normal=up), [1, 0, 0, 0, 1, 1], atol=1e-6)
