"""Patches through layers by blocks: what one pass over all of them gives, and NumPy's statistics."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.prepare.denoise.lidia import stages
from jaxsim.prepare.denoise.lidia.stages import EPS, BatchNorm, Moments, Stage, through

N, CHANNELS, CELLS = 70, 3, 5


@pytest.fixture
def features():
    rng = np.random.default_rng(0)
    x = rng.normal(40, 0.5, (CHANNELS, N, CELLS)).astype(np.float32)  # a mean that small deviations drown in
    return x, (rng.random(N) < 0.7).astype(np.float32)


def norm():
    made = BatchNorm(CHANNELS)
    rng = np.random.default_rng(1)
    for part in (made.weight, made.bias, made.running_mean):
        part[...] = jnp.asarray(rng.normal(1, 0.2, CHANNELS), jnp.float32)
    made.running_var[...] = jnp.asarray(rng.uniform(0.5, 2, CHANNELS), jnp.float32)
    return made


def test_moments_of_blocks_are_those_of_all(features):
    x, counted = features
    seen = x[:, counted > 0].astype(np.float64)
    cut = [x[:, k : k + 10] for k in range(0, N, 10)]
    each = [Moments.of(jnp.asarray(part), jnp.asarray(counted[10 * k :][:10])) for k, part in enumerate(cut)]
    joined = jax.tree.map(lambda *leaves: jnp.stack(leaves), *each).joined()
    for moments in (Moments.of(jnp.asarray(x), jnp.asarray(counted)), joined):
        np.testing.assert_allclose(moments.number, seen[0].size)
        np.testing.assert_allclose(moments.mean, seen.mean((1, 2)), rtol=1e-6)
        np.testing.assert_allclose(moments.deviation / moments.number, seen.var((1, 2)), rtol=1e-3)


def test_nothing_that_counts_has_moments_of_nothing(features):
    x, counted = features
    moments = Moments.of(jnp.asarray(x), jnp.asarray(0 * counted))
    assert np.isfinite(norm().by(jnp.asarray(x), moments)).all()


def two_stages(layer):
    """A stage that is normalised, one that sees its result, and the end that sees both."""
    return [
        Stage(lambda x, shift: x + shift, layer),
        Stage(lambda first: 2 * first),
        Stage(lambda first, second: first - second[:, :, :1]),
    ]


@pytest.mark.parametrize("chunk", [10**6, 32])
def test_blocks_give_what_one_pass_gives(features, chunk, monkeypatch):
    monkeypatch.setattr(stages, "BLOCK", 16)
    x, counted = features
    layer, shift = norm(), np.float32(0.5) * np.ones((1, N, 1), np.float32)

    def oracle(x, counted):
        seen = (x + 0.5)[:, counted > 0].astype(np.float64)
        mean, deviation = seen.mean((1, 2)), np.sqrt(seen.var((1, 2)) + EPS)
        scaled = (x + 0.5 - mean[:, None, None]) / deviation[:, None, None]
        first = np.maximum(np.asarray(layer.weight)[:, None, None] * scaled + np.asarray(layer.bias)[:, None, None], 0)
        return 2 * first, first - 2 * first[:, :, :1]

    run = jax.jit(
        lambda x, shift, counted: through(
            two_stages(layer), (x, shift), counted=counted, statistics="image", chunk=chunk, keep=2
        )
    )
    answer = run(x, shift, counted)
    # Statistics of each chunk alone.
    parts = [oracle(x[:, k : k + chunk], counted[k : k + chunk]) for k in range(0, N, chunk)]
    for mine, right in zip(answer, zip(*parts, strict=True), strict=True):
        np.testing.assert_allclose(mine, np.concatenate(right, axis=1), atol=2e-3)


def test_stored_statistics_need_no_patches(features):
    x, counted = features
    layer, shift = norm(), np.zeros((1, N, 1), np.float32)
    steps = {"counted": jnp.asarray(counted), "statistics": "stored"}
    whole = through(two_stages(layer), (jnp.asarray(x), jnp.asarray(shift)), chunk=N, **steps)
    parts = through(two_stages(layer), (jnp.asarray(x), jnp.asarray(shift)), chunk=9, **steps)
    np.testing.assert_allclose(whole[0], parts[0], rtol=1e-6)
    first = np.maximum(np.asarray(layer(jnp.asarray(x), jnp.asarray(counted), "stored")), 0)
    np.testing.assert_allclose(whole[0], first - 2 * first[:, :, :1], rtol=1e-5)


def test_training_moves_the_stored_statistics_to_those_of_the_patches(features):
    x, counted = features
    layer = norm()
    before = np.asarray(layer.running_mean)
    graph, state = nnx.split(layer)

    @jax.jit
    def learn(state):
        merged = nnx.merge(graph, state)
        through(
            [Stage(lambda x: x, merged)],
            (jnp.asarray(x),),
            counted=jnp.asarray(counted),
            statistics="training",
            chunk=N,
        )
        return merged.running_mean[...]

    mean = x[:, counted > 0].mean((1, 2))
    np.testing.assert_allclose(learn(state), 0.9 * before + 0.1 * mean, rtol=1e-5)
