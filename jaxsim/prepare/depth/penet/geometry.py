"""Where the cells of a sparse depth image are in space, at every scale of the network.

Coordinates are vertical, horizontal, depth, in metres; 0 where a cell holds no point. `exact`: u, v are a cell's mean
pixel coordinates. `published`: as the published program has them, with which its weights were trained: a cell's place
runs from 0 to the *scaled-down* size 352 x 1216, less the *full-size* principal point, whatever the image's size.
"""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import Array

Convention = Literal["exact", "published"]
PUBLISHED_SIZE = (352, 1216)


def nearest_of_four(
    depth_m: Float[Array, "b h w"], valid: Bool[Array, "b h w"]
) -> tuple[Float[Array, "b h/2 w/2"], Bool[Array, "b h/2 w/2"]]:
    """Half the rows and columns: the nearest valid depth of each 2 x 2, and whether there is one."""
    far = jnp.where(valid, depth_m, jnp.inf)
    b, h, w = depth_m.shape
    nearest = far.reshape(b, h // 2, 2, w // 2, 2).min((2, 4))
    known = jnp.isfinite(nearest)
    return jnp.where(known, nearest, 0.0), known


def coordinates(
    depth_m: Float[Array, "b h w"],
    valid: Bool[Array, "b h w"],
    intrinsics: Float[Array, "b 3 3"],
    *,
    scales: int,
    convention: Convention,
) -> list[Float[Array, "b _h _w 3"]]:
    """Coordinates of the image's cells and of its halvings, `scales` rasters, the finest first."""
    places = [_places(size, scales) for size in depth_m.shape[1:]]
    focal = jnp.diagonal(intrinsics, axis1=1, axis2=2)[..., None, None]
    centre = intrinsics[:, :, 2][..., None, None]
    result = []
    for k in range(scales):
        across = [along[k] for along in places]
        if convention == "published":
            # From -1 to 1 over the image, averaged two by two.
            across = [
                0.5 * full / 2**k * (2 * along[k] / along[0][-1])
                for full, along in zip(PUBLISHED_SIZE, places, strict=True)
            ]
        v = jnp.asarray(across[0], jnp.float32)[None, :, None]
        u = jnp.asarray(across[1], jnp.float32)[None, None, :]
        z = jnp.where(valid, depth_m, 0.0)
        # The pinhole camera inverted at depth z.
        down = z * (v - centre[:, 1]) / focal[:, 1]
        right = z * (u - centre[:, 0]) / focal[:, 0]
        result.append(jnp.stack([down, right, z], -1))
        if k + 1 < scales:
            depth_m, valid = nearest_of_four(depth_m, valid)
    return result


def _places(size: int, scales: int) -> list[np.ndarray]:
    """Mean pixel coordinate of each cell along one axis, for every scale."""
    places = [np.arange(size, dtype=np.float64)]
    for _ in range(scales - 1):
        places.append(places[-1].reshape(-1, 2).mean(1))
    return places


def twice(x: Float[Array, "b h w *c"]) -> Float[Array, "b _h _w *c"]:
    """Twice the rows and columns, each cell repeated."""
    return jnp.repeat(jnp.repeat(x, 2, 1), 2, 2)
