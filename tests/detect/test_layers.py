"""Layers, against PyTorch's values."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from jaxsim.detect.layers import ConvBlock, FullyConnected, Linear, UpBlock
from jaxsim.detect.steps import join, split
from tests.detect.made_dense_blocks import block, connected, convolved, drawn, enlarged, used

pytestmark = pytest.mark.usefixtures("quick_programs", "float64")


@pytest.mark.parametrize(("stride", "size"), [(1, (5, 6)), (2, (5, 6)), (2, (6, 7))])
def test_a_convolution_from_above_pads_both_sides(stride, size):
    x = np.random.default_rng(1).normal(size=(2, *size, 3))
    definition, network = drawn(lambda: ConvBlock(3, 4, stride=stride, rngs=nnx.Rngs(0)))
    wanted = block(x, network.parameters, network.statistics, lambda x, kernel: convolved(x, kernel, stride))
    assert (wanted > 0).any()
    np.testing.assert_allclose(used(definition, network, x, train=False), wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("stride", [1, 2, 3])
def test_a_transposed_convolution_makes_cells_of_each_cell(stride):
    x = np.random.default_rng(2).normal(size=(2, 3, 4, 3))
    definition, network = drawn(lambda: UpBlock(3, 5, stride=stride, rngs=nnx.Rngs(0)))
    wanted = block(x, network.parameters, network.statistics, enlarged)
    assert wanted.shape == (2, 3 * stride, 4 * stride, 5)
    np.testing.assert_allclose(used(definition, network, x, train=False), wanted, rtol=1e-9, atol=1e-12)


def test_fully_connected_layers_are_linear_maps_with_batch_norm():
    definition, network = drawn(lambda: FullyConnected(5, (4, 3), 0.3, rngs=nnx.Rngs(0)))
    x = np.random.default_rng(8).normal(size=(2, 6, 5))
    wanted = connected(x, network.parameters, network.statistics)
    np.testing.assert_allclose(used(definition, network, x, key=None), wanted, rtol=1e-9, atol=1e-12)


def second_layers_input(definition, network, x, dropout, monkeypatch):
    """In training."""
    module, seen = join(definition, network), []
    module.dropout = dropout
    monkeypatch.setattr(Linear, "__call__", lambda self, x: (seen.append(np.asarray(x)), x @ self.kernel[...])[1])
    module(jnp.asarray(x), key=jax.random.key(1))
    return seen[1]


def test_dropout_lies_between_the_layers_and_makes_up_for_what_falls_out(monkeypatch):
    definition, network = split(FullyConnected(6, (16, 8), 0.3, rngs=nnx.Rngs(0)))
    x = np.random.default_rng(9).normal(size=(400, 6))
    dropped, whole = (second_layers_input(definition, network, x, share, monkeypatch) for share in (0.3, 0.0))
    open_, kept = whole > 0, dropped != 0  # ReLU's own zeros aside
    assert abs(1 - kept[open_].mean() - 0.3) < 0.03
    np.testing.assert_allclose(dropped[kept], whole[kept] / 0.7, rtol=1e-9)
