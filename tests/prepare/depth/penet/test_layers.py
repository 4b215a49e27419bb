"""PENet's layers: how depth spreads, and statistics of batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.prepare.depth.penet.layers import (
    MOST_SCALE,
    MOST_SHIFT,
    BatchNorm,
    Guide,
    TransposedConv,
    from_neighbours,
    propagate,
    step,
)


@pytest.mark.parametrize(("k", "dilation"), [(3, 2), (5, 1)])
def test_depth_spreads_as_the_formula_says(k, dilation):
    rng = np.random.default_rng(k)
    h, w, c = 9, 11, k // 2
    guide = rng.standard_normal((1, h, w, k * k)).astype(np.float32)
    depth, start = rng.uniform(1, 9, (2, 1, h, w)).astype(np.float32)
    moved = np.asarray(jax.jit(from_neighbours)(guide))
    taps = [moved[..., o] for o in range(k * k)]
    out = np.asarray(jax.jit(step, static_argnames="dilation")(taps, depth, start, dilation=dilation))
    for row in range(h):
        for column in range(w):
            total = 0.0
            for o in range(k * k):
                i, j = o // k - c, o % k - c
                beside = 0 <= row + i < h and 0 <= column + j < w
                weight = guide[0, row + i, column + j, k * k - 1 - o] if beside else 0.0
                assert moved[0, row, column, o] == pytest.approx(weight)
                r, s = row + dilation * i, column + dilation * j
                if o == k * k // 2:
                    total += weight * start[0, row, column]
                elif 0 <= r < h and 0 <= s < w:
                    total += weight * depth[0, r, s]
            assert out[0, row, column] == pytest.approx(total, rel=1e-4, abs=1e-4)


def test_trusted_points_are_kept_and_affinities_sum_to_one():
    guide = Guide(4, 3, rngs=nnx.Rngs(0))(
        jnp.asarray(np.random.default_rng(0).random((1, 8, 8, 4)), jnp.float32), train=False
    )
    np.testing.assert_allclose(np.asarray(guide.sum(-1)), 1, atol=1e-5)
    neighbours = jnp.abs(guide).sum(-1) - jnp.abs(guide[..., 4])
    np.testing.assert_allclose(np.asarray(neighbours), 1, atol=1e-5)
    start = jnp.full((1, 8, 8), 5.0)
    sparse = jnp.zeros((1, 8, 8)).at[0, 3, 3].set(20.0)
    trust = (sparse > 0).astype(jnp.float32)
    confidence = jnp.full((1, 8, 8, 3), 0.25)
    out = propagate([from_neighbours(guide)] * 3, confidence, start, sparse=sparse, trust=trust, dilation=1)
    assert float(out[0, 3, 3]) == 15  # three kernels hold the point's 20


@pytest.mark.parametrize(("size", "stride"), [(5, 2), (3, 1)])
def test_a_transposed_convolution_spreads_every_cell_over_its_taps(size, stride):
    layer = TransposedConv(2, 3, size, stride=stride, rngs=nnx.Rngs(1))
    x = np.random.default_rng(0).standard_normal((1, 4, 5, 2)).astype(np.float32)
    published = np.asarray(layer.kernel[...])[::-1, ::-1]
    full = np.zeros((4 * stride + 2 * size, 5 * stride + 2 * size, 3))
    for i in range(4):
        for j in range(5):
            full[stride * i : stride * i + size, stride * j : stride * j + size] += np.einsum(
                "c,abco->abo", x[0, i, j], published
            )
    half = size // 2
    expected = full[half : half + 4 * stride, half : half + 5 * stride]
    np.testing.assert_allclose(np.asarray(layer(jnp.asarray(x)))[0], expected, atol=1e-5)


def test_renormalised_batches_give_what_the_stored_statistics_give_and_move_them():
    rng = np.random.default_rng(0)
    x = jnp.asarray(rng.normal([3.0, -1.0], [2.0, 0.5], (2, 8, 8, 2)), jnp.float32)
    norm = BatchNorm(2)
    norm.running_mean[...], norm.running_var[...] = jnp.array([2.0, -1.5]), jnp.array([3.0, 0.5])
    norm.weight[...], norm.bias[...] = jnp.array([2.0, 0.5]), jnp.array([10.0, 1.0])
    stored = np.asarray(norm(x, train=False))
    np.testing.assert_allclose(np.asarray(norm(x, train="renorm")), stored, rtol=1e-4, atol=1e-4)
    assert 2 < norm.running_mean[...][0] < 2.1
    # A batch's own statistics take away how far its values are; these do not.
    far = np.asarray(norm(x + 4, train="renorm")) - np.asarray(norm(x, train="renorm"))
    assert far[..., 0].mean() > 3
    assert abs(np.asarray(norm(x + 4, train=True) - norm(x, train=True))).max() < 1e-4


def test_a_batch_far_from_the_stored_statistics_is_held():
    norm = BatchNorm(1)
    x = jnp.asarray(np.random.default_rng(0).normal(500.0, 100.0, (1, 8, 8, 1)), jnp.float32)
    out = np.asarray(norm(x, train="renorm"))
    assert out.mean() == pytest.approx(MOST_SHIFT, abs=1e-3)
    assert out.std() == pytest.approx(MOST_SCALE, abs=1e-3)
