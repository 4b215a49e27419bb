"""LIDIA's network."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.prepare.denoise.lidia import Variant, published_shapes
from jaxsim.prepare.denoise.lidia.network import BatchNorm


@pytest.mark.parametrize(
    ("variant", "parameters"), [(Variant(), 61_589), (Variant(colour=True), 94_067), (Variant(small=True), 40_226)]
)
def test_parameters_are_as_many_as_published(variant, parameters):
    shapes = published_shapes(variant)
    assert sum(int(np.prod(s)) for name, s in shapes.items() if "running" not in name) == parameters


def test_names_are_those_of_the_published_state_dict(samples):
    for name, variant in (("sigma_25_bw", Variant()), ("small_sigma_25_bw", Variant(small=True))):
        theirs = np.load(samples / f"weights_lidia/model_state_{name}.npz")
        left = {n for n in theirs.files if not n.endswith(("num_batches_tracked", "bilinear_conv.weight"))}
        assert {n: theirs[n].shape for n in left} == published_shapes(variant)


def test_training_moves_the_stored_statistics_a_tenth_of_the_way():
    x = jnp.asarray(np.random.default_rng(4).normal(3.0, 2.0, (2, 50, 6)), jnp.float32)
    counted = jnp.ones(50).at[40:].set(0.0)
    norm = BatchNorm(2)
    out = np.asarray(norm(x, counted, "training"))
    seen = np.asarray(x)[:, :40].reshape(2, -1)
    np.testing.assert_allclose(np.asarray(norm.running_mean[...]), 0.1 * seen.mean(1), rtol=1e-5)
    np.testing.assert_allclose(np.asarray(norm.running_var[...]), 0.9 + 0.1 * seen.var(1, ddof=1), rtol=1e-5)
    np.testing.assert_allclose(out[:, :40].mean((1, 2)), 0, atol=1e-5)
    np.testing.assert_allclose(out[:, :40].std((1, 2)), 1, rtol=1e-4)
