"""Sizes, order and init of the layers, as the published networks have them."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import DiscriminatorConfig, GeneratorConfig
from jaxsim.pix2pix.networks import Discriminator, Generator
from jaxsim.pix2pix.steps import Network, join, split
from tests.pix2pix.published_names import to_published
from tests.quick import quick_jit


def sizes(make) -> Network:
    return jax.eval_shape(lambda: split(make())[1])


def count(network: Network) -> int:
    return sum(leaf.size for leaf in jax.tree.leaves(network.parameters))


@pytest.mark.parametrize(
    ("channels", "out_channels", "enhancers", "parameters"),
    [
        (36, 3, 0, 182_589_507),
        (36, 3, 1, 182_900_835),
        (3, 3, 1, 182_745_603),
        (24, 3, 1, 182_844_387),
        (36, 1, 1, 182_900_835 - 3_138),
    ],
)
def test_generator_has_the_published_number_of_parameters(channels, out_channels, enhancers, parameters):
    config = GeneratorConfig(enhancers=enhancers, out_channels=out_channels)
    assert count(sizes(lambda: Generator(config, channels, nnx.Rngs(0)))) == parameters


@pytest.mark.parametrize("scales", [1, 2, 3])
def test_discriminator_has_the_published_number_of_parameters(scales):
    config = DiscriminatorConfig(scales=scales)
    assert count(sizes(lambda: Discriminator(config, 39, nnx.Rngs(0)))) == scales * 1_578_241


def test_the_original_form_starts_from_the_published_distribution():
    """Kernels of deviation 0.02, biases uniform up to 1 / sqrt(fan in), no parameters in norms."""
    config = GeneratorConfig(form="original", filters=32, downsamples=2, blocks=1)
    generator = quick_jit(lambda: split(Generator(config, 5, nnx.Rngs(0)))[1])()
    assert not generator.vectors
    block = generator.parameters["coarse"]["blocks"][0]["first"]
    assert set(block) == {"conv"}
    kernel, bias = block["conv"]["kernel"], block["conv"]["bias"]
    assert abs(float(kernel.std()) - 0.02) < 4e-4
    largest = (9 * 128) ** -0.5
    assert 0.9 * largest < float(jnp.abs(bias).max()) <= largest


@pytest.mark.parametrize("form", ["imaginaire", "original"])
def test_bfloat16_convolutions_give_nearly_the_same_image(form):
    config = GeneratorConfig(form=form, filters=8, downsamples=1, blocks=1, enhancer_blocks=1)
    inputs = np.random.default_rng(0).uniform(-1, 1, (1, 16, 32, 4)).astype(np.float32)
    make = lambda precision: Generator(config, 4, nnx.Rngs(0), precision=precision)  # noqa: E731
    like = jax.eval_shape(lambda: split(make("bfloat16"))[1])
    assert {leaf.dtype for leaf in jax.tree.leaves(like)} == {jnp.dtype("float32")}
    random = np.random.default_rng(1)
    values = jax.tree.map(lambda x: (0.1 * random.standard_normal(x.shape)).astype(np.float32), like)
    definitions = [nnx.graphdef(nnx.eval_shape(partial(make, p))) for p in ("float32", "bfloat16")]
    images = [quick_jit(lambda v, x, d=d: join(d, v)(x))(values, inputs) for d in definitions]
    assert {image.dtype for image in images} == {jnp.dtype("float32")}
    error = np.abs(images[0] - images[1])
    assert 0 < error.max() < 0.05 * np.abs(images[0]).max() + 1e-3


def test_generator_layers_are_the_published_ones():
    """Kernels in the order they are met: size, then channels in and out."""
    config = GeneratorConfig(out_channels=3)
    generator = sizes(lambda: Generator(config, 36, nnx.Rngs(0))).parameters
    coarse, enhancer = generator["coarse"], generator["enhancers"][0]

    def shape(block):
        return block["conv"]["kernel"].shape

    assert shape(coarse["stem"]) == (7, 7, 36, 64)
    assert [shape(coarse["down"][i])[2:] for i in range(4)] == [(64, 128), (128, 256), (256, 512), (512, 1024)]
    assert len(coarse["blocks"]) == 9
    assert {shape(block[half]) for block in coarse["blocks"].values() for half in block} == {(3, 3, 1024, 1024)}
    assert [shape(coarse["up"][i])[2:] for i in range(4)] == [(1024, 512), (512, 256), (256, 128), (128, 64)]
    assert "head" not in coarse
    assert shape(enhancer["stem"]) == (7, 7, 36, 32)
    assert shape(enhancer["down"][0]) == (3, 3, 32, 64)
    assert len(enhancer["blocks"]) == 3
    assert shape(enhancer["up"][0]) == (3, 3, 64, 32)
    assert shape(enhancer["head"]) == (7, 7, 32, 3)


def test_final_convolution_has_neither_norm():
    vectors = sizes(lambda: Generator(GeneratorConfig(), 5, nnx.Rngs(0))).vectors
    assert "head" not in vectors["enhancers"][0]
    assert "stem" in vectors["enhancers"][0]
    parameters = sizes(lambda: Generator(GeneratorConfig(), 5, nnx.Rngs(0))).parameters
    assert set(parameters["enhancers"][0]["head"]) == {"conv"}


def test_discriminator_layers_are_the_published_ones():
    config = DiscriminatorConfig(scales=3)
    module = nnx.eval_shape(lambda: Discriminator(config, 39, nnx.Rngs(0)))
    inputs, image = (jax.ShapeDtypeStruct((1, 64, 512, c), jnp.float32) for c in (36, 3))
    judged = jax.eval_shape(lambda m, a, b: m(a, b), module, inputs, image)
    shapes = [([f.shape[1:] for f in features], logits.shape[1:]) for logits, features in judged]
    assert shapes == [
        ([(32, 256, 64), (16, 128, 128), (8, 64, 256), (8, 64, 512)], (8, 64, 1)),
        ([(16, 128, 64), (8, 64, 128), (4, 32, 256), (4, 32, 512)], (4, 32, 1)),
        ([(8, 64, 64), (4, 32, 128), (2, 16, 256), (2, 16, 512)], (2, 16, 1)),
    ]


@pytest.mark.long
@pytest.mark.parametrize("enhancers", [0, 1, pytest.param(2, marks=pytest.mark.slow)])
def test_image_has_the_size_of_the_inputs(enhancers):
    config = GeneratorConfig(filters=8, downsamples=1, blocks=1, enhancers=enhancers, enhancer_blocks=1, out_channels=2)
    image = quick_jit(lambda: Generator(config, 3, nnx.Rngs(0))(jnp.ones((2, 16, 32, 3))))()
    assert image.shape == (2, 16, 32, 2)
    assert jnp.abs(image).max() <= 1


def test_kernels_start_by_xavier_with_gain_0_02_and_biases_at_0():
    config = GeneratorConfig(filters=32, downsamples=2, blocks=1)
    network = quick_jit(lambda: split(Generator(config, 5, nnx.Rngs(0)))[1])()
    for name, array in to_published(network).items():
        if array.ndim == 4:
            wide, narrow, kh, kw = array.shape
            deviation = 0.02 * (2 / ((wide + narrow) * kh * kw)) ** 0.5
            np.testing.assert_allclose(array.std(), deviation, rtol=0.1, err_msg=name)
            assert abs(array.mean()) < 0.1 * deviation
        elif name.endswith(("_u", "_v")):
            np.testing.assert_allclose(np.linalg.norm(array), 1, rtol=1e-5)
        else:
            np.testing.assert_array_equal(array, float(name.endswith("norm.weight")), err_msg=name)


def test_sizes_that_do_not_divide_are_refused():
    def judge(inputs, image):
        return Discriminator(DiscriminatorConfig(filters=4, scales=3), 4, nnx.Rngs(0))(inputs, image)

    config = GeneratorConfig(filters=4, downsamples=2, blocks=1)
    with pytest.raises(ValueError, match="multiples of 8"):
        jax.eval_shape(lambda x: Generator(config, 3, nnx.Rngs(0))(x), jnp.ones((1, 44, 372, 3)))
    with pytest.raises(ValueError, match="multiples of 4"):
        jax.eval_shape(judge, jnp.ones((1, 10, 16, 3)), jnp.ones((1, 10, 16, 1)))
    with pytest.raises(ValueError, match="multiple of 4"):
        Generator(GeneratorConfig(filters=6, enhancers=2), 3, nnx.Rngs(0))
