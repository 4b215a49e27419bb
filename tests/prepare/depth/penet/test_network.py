"""Where PENet's cells are."""

import jax.numpy as jnp
import numpy as np

from jaxsim.prepare.depth.penet.network import coordinates, nearest_of_four
from tests.prepare.depth.penet.made_published import inputs


def test_published_coordinates_are_the_published_ones(vectors):
    _, sparse, given, intrinsics = inputs(vectors)
    geo = coordinates(sparse, given, intrinsics, scales=6, convention="published")
    for k, name in ((1, "geo_s2"), (3, "geo_s4")):
        np.testing.assert_allclose(np.asarray(geo[k]).transpose(0, 3, 1, 2), vectors[name], rtol=1e-5, atol=1e-5)


def test_exact_coordinates_are_where_the_points_are():
    rng = np.random.default_rng(0)
    intrinsics = np.array([[700.0, 0, 31.0], [0, 710, 12.5], [0, 0, 1]], np.float32)
    depth = rng.uniform(5, 50, (1, 32, 64)).astype(np.float32)
    given = rng.random(depth.shape) < 0.3
    fine, half, *_ = coordinates(depth, given, intrinsics[None], scales=3, convention="exact")
    v, u = np.mgrid[:32, :64]
    ray = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(intrinsics).T
    expected = np.where(given[0][..., None], ray * depth[0][..., None], 0)[..., [1, 0, 2]]
    np.testing.assert_allclose(np.asarray(fine)[0], expected, rtol=1e-4, atol=1e-4)
    # At half the size a cell's place is the middle of its four pixels, seen with the same camera.
    nearest, known = (np.asarray(x)[0] for x in nearest_of_four(jnp.asarray(depth), jnp.asarray(given)))
    np.testing.assert_allclose(
        np.asarray(half)[0, ..., 1], nearest * (2 * np.arange(32) + 0.5 - 31.0) / 700.0, rtol=1e-4, atol=1e-4
    )
    assert (nearest[~known] == 0).all()
    blocks = np.where(given, depth, np.inf)[0].reshape(16, 2, 32, 2).min((1, 3))
    np.testing.assert_array_equal(nearest[known], blocks[np.isfinite(blocks)])
