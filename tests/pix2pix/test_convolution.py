"""Every form of convolution against sums written out, and the CPU's gradients against XLA's own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.pix2pix import convolution
from jaxsim.pix2pix.convolution import average_pool, conv2d, halve, transposed_conv2d, upsample_conv2d


def slow_conv2d(x, kernel, stride, padding):
    kh, kw, _, wide = kernel.shape
    mode = "reflect" if padding == "reflect" else "constant"
    x = np.pad(x, ((0, 0), (kh // 2, kh // 2), (kw // 2, kw // 2), (0, 0)), mode=mode)
    rows, columns = (x.shape[1] - kh) // stride + 1, (x.shape[2] - kw) // stride + 1
    y = np.zeros((x.shape[0], rows, columns, wide))
    for i in range(rows):
        for j in range(columns):
            patch = x[:, i * stride : i * stride + kh, j * stride : j * stride + kw]
            y[:, i, j] = np.tensordot(patch, kernel, 3)
    return y


def draw(seed, *shapes):
    random = np.random.default_rng(seed)
    return [random.standard_normal(shape).astype(np.float32) for shape in shapes]


# Shapes that reach each form: many cells, few cells and many channels, stride 2, large kernels.
CASES = [
    (2, 8, 12, 3, 4, 3, 1),
    (2, 2, 4, 5, 16, 3, 1),
    (2, 8, 12, 3, 4, 3, 2),
    (1, 4, 4, 6, 32, 3, 2),
    (1, 8, 8, 2, 3, 7, 1),
]


@pytest.mark.parametrize("padding", ["reflect", "zero"])
@pytest.mark.parametrize(("b", "h", "w", "narrow", "wide", "size", "stride"), CASES)
def test_convolution_is_the_sum_over_padded_cells(b, h, w, narrow, wide, size, stride, padding):
    x, kernel = draw(0, (b, h, w, narrow), (size, size, narrow, wide))
    ours = conv2d(x, kernel, stride=stride, padding=padding)
    np.testing.assert_allclose(ours, slow_conv2d(x, kernel, stride, padding), rtol=0, atol=2e-5)


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 3), st.integers(4, 7), st.integers(4, 9), st.sampled_from([1, 2]), st.integers(0, 99))
def test_convolution_holds_for_any_size(b, h, w, stride, seed):
    x, kernel = draw(seed, (b, h, w, 2), (3, 3, 2, 3))
    ours = conv2d(x, kernel, stride=stride)
    np.testing.assert_allclose(ours, slow_conv2d(x, kernel, stride, "reflect"), rtol=0, atol=2e-5)


@pytest.mark.parametrize(("h", "w", "wide"), [(3, 5, 4), (2, 3, 32)])
def test_up_sampling_convolution_is_that_of_repeated_cells(h, w, wide):
    x, kernel = draw(1, (2, h, w, 5), (3, 3, 5, wide))
    slow = slow_conv2d(x.repeat(2, 1).repeat(2, 2), kernel, 1, "reflect")
    np.testing.assert_allclose(upsample_conv2d(x, kernel), slow, rtol=0, atol=2e-5)


@pytest.mark.parametrize(("h", "w", "wide"), [(3, 5, 4), (2, 3, 32)])
@pytest.mark.parametrize("on_cpu", [True, False])
def test_transposed_convolution_spreads_every_cell(monkeypatch, on_cpu, h, w, wide):
    """PyTorch's definition: each cell adds its kernel at twice its place, less the padding of one."""
    monkeypatch.setattr(convolution, "on_cpu", lambda: on_cpu)
    x, kernel = draw(1, (2, h, w, 5), (3, 3, 5, wide))
    spread = np.zeros((2, 2 * h + 2, 2 * w + 2, wide))
    for i in range(h):
        for j in range(w):
            spread[:, 2 * i : 2 * i + 3, 2 * j : 2 * j + 3] += np.einsum(
                "bc,rsck->brsk", x[:, i, j], kernel[::-1, ::-1]
            )
    ours = transposed_conv2d(x, kernel)
    np.testing.assert_allclose(ours, spread[:, 1 : 2 * h + 1, 1 : 2 * w + 1], rtol=0, atol=2e-5)


def gradients(function, x, kernel):
    def total(x, kernel):
        return (jnp.sin(function(x, kernel))).sum()

    return jax.jit(jax.grad(total, (0, 1)))(x, kernel)


@pytest.mark.parametrize("padding", ["reflect", "zero"])
@pytest.mark.parametrize(("b", "h", "w", "narrow", "wide", "size", "stride"), CASES)
def test_gradients_of_both_forms_agree(monkeypatch, b, h, w, narrow, wide, size, stride, padding):
    x, kernel = draw(2, (b, h, w, narrow), (size, size, narrow, wide))

    def form(x, kernel):
        return conv2d(x, kernel, stride=stride, padding=padding)

    on_cpu = gradients(form, x, kernel)
    monkeypatch.setattr(convolution, "on_cpu", lambda: False)
    for ours, xla in zip(on_cpu, gradients(lambda *a: form(*a), x, kernel), strict=True):
        np.testing.assert_allclose(ours, xla, rtol=0, atol=1e-4)


@pytest.mark.parametrize("wide", [4, 32])
def test_up_sampling_gradients_of_both_forms_agree(monkeypatch, wide):
    x, kernel = draw(3, (2, 3, 5, 6), (3, 3, 6, wide))
    on_cpu = gradients(upsample_conv2d, x, kernel)
    monkeypatch.setattr(convolution, "on_cpu", lambda: False)
    for ours, xla in zip(on_cpu, gradients(lambda *a: upsample_conv2d(*a), x, kernel), strict=True):
        np.testing.assert_allclose(ours, xla, rtol=0, atol=1e-4)


def test_average_pool_counts_only_cells_that_are_there():
    (x,) = draw(4, (2, 6, 8, 3))
    padded = np.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    slow = [[np.nanmean(padded[:, i : i + 3, j : j + 3], (1, 2)) for j in range(0, 8, 2)] for i in range(0, 6, 2)]
    np.testing.assert_allclose(average_pool(x), np.array(slow).transpose(2, 0, 1, 3), atol=1e-6)


@pytest.mark.parametrize(("h", "w"), [(2, 8), (6, 4)])
def test_halving_keeps_corner_cells(h, w):
    (x,) = draw(5, (2, h, w, 3))
    weights = []
    for n in (h, w):
        at = np.linspace(0, n - 1, n // 2) if n > 2 else np.zeros(1)
        weights.append(np.maximum(0, 1 - np.abs(at[:, None] - np.arange(n))))
    slow = np.einsum("ih,jw,bhwc->bijc", *weights, x)
    np.testing.assert_allclose(halve(x), slow, atol=1e-6)
