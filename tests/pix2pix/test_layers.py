"""Norms against NumPy in float64, and their gradients against automatic differentiation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.config import GeneratorConfig
from jaxsim.pix2pix import layers
from jaxsim.pix2pix.layers import fold_spectral_norm, instance_norm, spectral_norm, unit_length
from jaxsim.pix2pix.networks import Generator
from jaxsim.pix2pix.steps import generator_definition, join, split
from tests.quick import quick_jit


def plain_norm(x, scale, shift, eps):
    mean, variance = x.mean((1, 2), keepdims=True), x.var((1, 2), keepdims=True)
    return (x - mean) / jnp.sqrt(variance + eps) * scale[None, None, None] + shift[None, None, None]


@pytest.fixture
def operands():
    random = np.random.default_rng(0)
    x = 3 + 2 * random.standard_normal((2, 4, 6, 5))
    return tuple(np.asarray(a, np.float32) for a in (x, random.standard_normal(5), random.standard_normal(5), 0.3))


@pytest.mark.parametrize("cpu", [True, False])
def test_instance_norm_and_its_gradients_are_those_of_the_formula(monkeypatch, operands, cpu):
    monkeypatch.setattr(layers, "on_cpu", lambda: cpu)
    x64 = operands[0].astype(np.float64)
    slow = (x64 - x64.mean((1, 2), keepdims=True)) / np.sqrt(x64.var((1, 2), keepdims=True) + 0.3)
    np.testing.assert_allclose(instance_norm(*operands), slow * operands[1] + operands[2], atol=1e-5)

    weight = np.random.default_rng(1).standard_normal(operands[0].shape).astype(np.float32)
    ours, plain = (
        jax.grad(lambda *a, f=f: (weight * jnp.tanh(f(*a))).sum(), (0, 1, 2, 3))(*operands)
        for f in (instance_norm, plain_norm)
    )
    for a, b in zip(ours, plain, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-4)


def test_power_iterations_find_the_largest_singular_value():
    random = np.random.default_rng(2)
    kernel = random.standard_normal((3, 3, 4, 6)).astype(np.float32)
    left, right = (unit_length(random.standard_normal(n).astype(np.float32)) for n in (6, 36))
    for _ in range(100):
        sigma, left, right = spectral_norm(kernel, left, right, advance=True)
    np.testing.assert_allclose(sigma, np.linalg.svd(kernel.reshape(36, 6))[1][0], rtol=1e-5)


def test_gradient_of_spectral_norm_flows_through_the_kernel_alone():
    random = np.random.default_rng(3)
    kernel = random.standard_normal((1, 1, 4, 3)).astype(np.float32)
    left, right = (unit_length(random.standard_normal(n).astype(np.float32)) for n in (3, 4))
    gradient = jax.grad(lambda k: spectral_norm(k, left, right, advance=True)[0])(kernel)
    _, left, right = spectral_norm(kernel, left, right, advance=True)
    np.testing.assert_allclose(gradient[0, 0], np.outer(right, left), atol=1e-6)


def test_eval_mode_leaves_the_vectors_alone():
    random = np.random.default_rng(4)
    kernel = random.standard_normal((1, 1, 4, 3)).astype(np.float32)
    given = tuple(unit_length(random.standard_normal(n).astype(np.float32)) for n in (3, 4))
    _, *kept = spectral_norm(kernel, *given)
    for a, b in zip(given, kept, strict=True):
        np.testing.assert_array_equal(a, b)


def test_folded_generator_makes_the_same_image():
    config = GeneratorConfig(filters=4, downsamples=1, blocks=1, enhancer_blocks=1)
    network = quick_jit(lambda: split(Generator(config, 3, nnx.Rngs(0)))[1])()
    inputs = np.random.default_rng(1).standard_normal((2, 8, 16, 3)).astype(np.float32)
    with_norm, plain = (generator_definition(config, 3, spectral=spectral) for spectral in (True, False))
    folded = nnx.merge(plain, fold_spectral_norm(network.parameters, network.vectors))
    image = quick_jit(lambda: join(with_norm, network)(inputs))()
    np.testing.assert_allclose(quick_jit(lambda: folded(inputs))(), image, atol=1e-6)
