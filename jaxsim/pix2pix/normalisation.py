"""Spectral norm of kernels and instance norm of features."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float

Array = Any
Tree = Any

UNIT_EPS = 1e-12
INSTANCE_EPS = 1e-5


class SpectralVector(nnx.Variable):
    """Estimate of a kernel's first singular vector: state that a forward pass advances, not trained."""


def unit(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """x at length 1."""
    return x / jnp.maximum(jnp.sqrt(jnp.sum(x * x)), UNIT_EPS)


def spectral_norm(
    kernel: Float[Array, "kh kw c_in c_out"],
    left: Float[Array, " c_out"],
    right: Float[Array, " kh*kw*c_in"],
    *,
    iterations: int = 0,
) -> tuple[Float[Array, ""], Float[Array, " c_out"], Float[Array, " kh*kw*c_in"]]:
    """Largest singular value of the kernel as a (kh kw c_in, c_out) matrix W, and its singular vectors.

    Each power iteration is right = unit(W left), left = unit(Wᵀ right). The value is leftᵀ Wᵀ right; its
    gradient flows through W alone (Miyato et al. 2018; `torch.nn.utils.spectral_norm`).
    """
    matrix = kernel.reshape(-1, kernel.shape[-1])
    frozen = jax.lax.stop_gradient(matrix)
    for _ in range(iterations - 1):
        right = unit(frozen @ left)
        left = unit(right @ frozen)
    if iterations:
        right = unit(frozen @ left)
    image = right @ matrix  # the last Wᵀ right serves the iteration and the value
    if iterations:
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


def instance_norm(
    x: Float[Array, "b h w c"], scale: Float[Array, " c"], shift: Float[Array, " c"]
) -> Float[Array, "b h w c"]:
    """(x - mean) / sqrt(variance + 1e-5) over rows and columns (biased variance), times scale, plus shift."""
    mean = x.mean((1, 2), keepdims=True)
    centred = x - mean
    variance = (centred * centred).mean((1, 2), keepdims=True)
    gain = jax.lax.rsqrt(variance + INSTANCE_EPS) * scale[None, None, None]
    return centred * gain + shift[None, None, None]
