"""Spectral norm of kernels and instance norm of features."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float

from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import on_cpu

Tree = Any

UNIT_EPS = 1e-12
INSTANCE_EPS = 1e-5


class SpectralVector(nnx.Variable):
    """Estimate of a kernel's first singular vector: state that a forward pass advances, not trained."""


def statistics_type(x: Array) -> Any:
    """Type in which sums over features of x are taken: float32 at least."""
    return x.dtype if x.dtype.itemsize >= 4 else jnp.dtype("float32")


def unit(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """x at length 1."""
    return x / jnp.maximum(jnp.sqrt(jnp.sum(x * x)), UNIT_EPS)


def spectral_norm(
    kernel: Float[Array, "kh kw c_in c_out"],
    left: Float[Array, " c_out"],
    right: Float[Array, " kh*kw*c_in"],
    *,
    advance: bool = False,
) -> tuple[Float[Array, ""], Float[Array, " c_out"], Float[Array, " kh*kw*c_in"]]:
    """Largest singular value of the kernel as a (kh kw c_in, c_out) matrix W, and its singular vectors.

    `advance` takes them a power iteration further: right = unit(W left), left = unit(Wᵀ right). The value is
    leftᵀ Wᵀ right; its gradient flows through W alone (Miyato et al. 2018; `torch.nn.utils.spectral_norm`).
    """
    matrix = kernel.reshape(-1, kernel.shape[-1])
    if advance:
        right = unit(jax.lax.stop_gradient(matrix) @ left)
    image = right @ matrix  # the last Wᵀ right serves the iteration and the value
    if advance:
        left = unit(jax.lax.stop_gradient(image))
    return left @ image, left, right


def fold_spectral_norm(parameters: Tree, vectors: Tree) -> Tree:
    """Parameters of the same network without spectral norm: every kernel divided by its value."""
    if "left" in vectors:
        sigma, _, _ = spectral_norm(parameters["kernel"], vectors["left"], vectors["right"])
        return {**parameters, "kernel": parameters["kernel"] / sigma}
    return {
        name: fold_spectral_norm(part, vectors[name]) if name in vectors else part for name, part in parameters.items()
    }


# Four in a row, since custom_vjp takes its arguments by place.
@jax.custom_vjp
def instance_norm(
    x: Float[Array, "b h w c"], scale: Float[Array, " c"], shift: Float[Array, " c"], eps: Float[Array, ""]
) -> Float[Array, "b h w c"]:
    """(x - mean) / sqrt(variance + eps) over rows and columns (biased variance), times scale, plus shift.

    Computed in the type of scale and shift, given back in that of x.
    """
    return _instance_norm(x, scale, shift, eps)[0]


def _instance_norm(x: Array, scale: Array, shift: Array, eps: Array) -> tuple[Array, tuple[Array, ...]]:
    cells, wide = x.shape[1] * x.shape[2], x.astype(scale.dtype)
    mean = _sum_cells(wide) / cells
    centred = wide - mean
    rate = jax.lax.rsqrt(_sum_cells(centred * centred) / cells + eps)
    gain = rate * scale[None, None, None]
    return (centred * gain + shift[None, None, None]).astype(x.dtype), (x, mean, rate, scale)


def _instance_norm_gradient(saved: tuple[Array, ...], gradient: Array) -> tuple[Array, ...]:
    """By hand: two sums over cells, where automatic differentiation takes five."""
    x, mean, rate, scale = saved
    cells, gradient = x.shape[1] * x.shape[2], gradient.astype(scale.dtype)
    normalised = (x.astype(scale.dtype) - mean) * rate
    # dL/dx = scale rate (g - mean(g) - n mean(g n)), with n the normalised x and means over cells.
    total = _sum_cells(gradient)
    along = _sum_cells(gradient * normalised)
    scale = scale[None, None, None]
    back = (scale * rate * (gradient - (total + normalised * along) / cells)).astype(x.dtype)
    back_eps = -0.5 * (rate * rate * scale * along).sum()
    return back, along.sum((0, 1, 2)), total.sum((0, 1, 2)), back_eps


instance_norm.defvjp(_instance_norm, _instance_norm_gradient)


def _sum_cells(x: Array) -> Array:
    """Sum over rows and columns, kept as axes of one."""
    b, h, w, c = x.shape
    if not on_cpu():
        return x.sum((1, 2), keepdims=True)
    # As products with ones: inside a step XLA's own reduction of leading axes is 5 to 10 times slower on a CPU. Row by
    # row: one product over all cells adds them up one after another, and loses two digits of the sum.
    ones = jnp.ones((b * h, 1, w), x.dtype)
    rows = jax.lax.dot_general(ones, x.reshape(b * h, w, c), (((2,), (1,)), ((0,), (0,))))
    return rows.reshape(b, h, 1, c).sum(1, keepdims=True)
