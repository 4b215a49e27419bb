"""What tests of published are made of."""

import jax.numpy as jnp
import numpy as np


def inputs(vectors):
    sparse = (vectors["sparse_depth_u16_div256"] / 256).astype(np.float32)[None]
    arrays = vectors["rgb_u8"][None].astype(np.float32), sparse, sparse > 0, vectors["K"][None]
    return tuple(jnp.asarray(array) for array in arrays)
