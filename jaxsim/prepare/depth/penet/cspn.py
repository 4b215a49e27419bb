"""DA-CSPN++: depth spreads to neighbours by learned affinities, with dilation and three kernel sizes.

Cheng et al., CSPN++, AAAI 2020; dilated and accelerated by Hu et al., ICRA 2021. k kernel width, o a neighbour's slot,
row by row, delta(o) its offset; c the middle slot. The middle tap takes the depth that the stage began with:

    d(p) <- sum over o != c of w_o(p) d(p + dilation delta(o)) + w_c(p) d_0(p)
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from flax import nnx
from jax import Array
from jaxtyping import Float

from jaxsim.prepare.depth.penet.layers import ConvBn, Mode

KERNELS = (3, 5, 7)


class Guide(nnx.Module):
    """Affinities of a kernel from features: they sum to 1, the neighbours' by magnitude to 1."""

    def __init__(self, channels: int, k: int, *, rngs: nnx.Rngs):
        self.generate = ConvBn(channels, k * k - 1, rngs=rngs)

    def __call__(self, features: Float[Array, "b h w c"], *, train: Mode) -> Float[Array, "b h w kk"]:
        guide = self.generate(features, train=train)
        guide = guide / jnp.abs(guide).sum(-1, keepdims=True)  # keeps repeated steps stable
        first, second = jnp.split(guide, 2, -1)
        return jnp.concatenate([first, 1 - guide.sum(-1, keepdims=True), second], -1)


def _offsets(k: int) -> list[tuple[int, int]]:
    return [(o // k - k // 2, o % k - k // 2) for o in range(k * k)]


def _shifted(x: Float[Array, "b h w"], down: int, right: int) -> Float[Array, "b h w"]:
    """x at (row + down, column + right); 0 outside."""
    pad = [(0, 0), (max(-down, 0), max(down, 0)), (max(-right, 0), max(right, 0))]
    h, w = x.shape[1:]
    top, left = max(down, 0), max(right, 0)
    return jnp.pad(x, pad)[:, top : top + h, left : left + w]


def from_neighbours(guide: Float[Array, "b h w kk"]) -> Float[Array, "b h w kk"]:
    """A cell weighs its neighbour o by what that neighbour holds for it: slot k*k - 1 - o there."""
    k = round(guide.shape[-1] ** 0.5)
    return jnp.stack([_shifted(guide[..., k * k - 1 - o], *offset) for o, offset in enumerate(_offsets(k))], -1)


def step(
    taps: Sequence[Float[Array, "b h w"]], depth: Float[Array, "b h w"], start: Float[Array, "b h w"], *, dilation: int
) -> Float[Array, "b h w"]:
    """One propagation; `taps` are the slots of what `from_neighbours` gives."""
    k = round(len(taps) ** 0.5)
    total = taps[k * k // 2] * start
    for o, (down, right) in enumerate(_offsets(k)):
        if o != k * k // 2:
            total = total + taps[o] * _shifted(depth, dilation * down, dilation * right)
    return total


def propagate(
    guides: list[Float[Array, "b h w _kk"]],
    confidence: Float[Array, "b h w 3"],
    start: Float[Array, "b h w"],
    *,
    sparse: Float[Array, "b h w"],
    trust: Float[Array, "b h w"],
    dilation: int,
    iterations: int = 6,
) -> Float[Array, "b h w"]:
    """A stage: every kernel spreads `start` and is led back to the sparse depth by `trust`; then they are weighed."""
    # One array a slot: the gradient of a slot of a common array is as large as that array, every time.
    taps = [jnp.unstack(guide, axis=-1) for guide in guides]

    def once(_: Array, depths: tuple[Array, ...]) -> tuple[Array, ...]:
        spread = [step(slots, depth, start, dilation=dilation) for slots, depth in zip(taps, depths, strict=True)]
        # The measured depth is put back after each step, as far as it is trusted.
        return tuple((1 - trust) * depth + trust * sparse for depth in spread)

    depths = jax.lax.fori_loop(0, iterations, once, (start,) * len(guides), unroll=False)
    return sum(confidence[..., i] * depth for i, depth in enumerate(depths))  # type: ignore[return-value]
