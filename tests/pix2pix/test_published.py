"""Names and layouts of published checkpoints, there and back."""

import jax
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import DiscriminatorConfig, GeneratorConfig
from jaxsim.pix2pix.networks import Discriminator, Generator
from jaxsim.pix2pix.published import from_published
from jaxsim.pix2pix.steps import split
from tests.pix2pix.published_names import to_published
from tests.quick import quick_jit


def generator(enhancers=1):
    config = GeneratorConfig(filters=8, downsamples=2, blocks=2, enhancers=enhancers, enhancer_blocks=1)
    return quick_jit(lambda: split(Generator(config, 3, nnx.Rngs(0)))[1])()


@pytest.mark.parametrize("network", ["generator", "discriminator"])
def test_weights_come_back_as_they_went(network):
    config = DiscriminatorConfig(filters=4, scales=2)
    judge = quick_jit(lambda: split(Discriminator(config, 5, nnx.Rngs(0)))[1])
    values = judge() if network == "discriminator" else generator()
    again = from_published(to_published(values), jax.eval_shape(lambda: values))
    assert all(jax.tree.leaves(jax.tree.map(np.array_equal, values, again)))


def test_names_are_those_of_the_published_state_dict(published, networks):
    arrays = published("state_dicts")
    for letter, network in zip("GD", networks, strict=True):
        ours = to_published(network)
        theirs = {name[2:]: array for name, array in arrays.items() if name.startswith(letter + ".")}
        assert sorted(ours) == sorted(theirs)
        for name, array in theirs.items():
            np.testing.assert_array_equal(ours[name], array, err_msg=name)


def test_a_global_generator_alone_stands_one_level_deeper():
    """As Imaginaire's `load_pretrained_network` expects it."""
    names = {name.rsplit(".layers", 1)[0] for name in to_published(generator(enhancers=0))}
    blocks = {f"global_model.model.{i}.conv_block_{j}" for i in (3, 4) for j in (0, 1)}
    assert names == blocks | {f"global_model.model.{i}" for i in (0, 1, 2, 6, 8, 9)}


def test_weights_of_another_size_are_refused_by_name():
    values = generator()
    arrays = to_published(values)
    del arrays["global_model.0.layers.norm.bias"]
    arrays["global_model.1.layers.norm.bias"] = np.zeros(7, np.float32)
    message = r"global_model\.0\.layers\.norm\.bias is missing, not \(8,\)"
    with pytest.raises(ValueError, match=message) as raised:
        from_published(arrays, values)
    assert "global_model.1.layers.norm.bias is (7,), not (16,)" in str(raised.value)
