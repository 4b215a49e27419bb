"""Loss terms, as Imaginaire's `losses/` has them; each a scalar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Float

Array = Any
Judgement = Sequence[tuple[Array, Sequence[Array]]]
"""What the discriminator says: (logits, features) of each scale."""


def hinge(judgement: Judgement, side: Literal["real", "fake"]) -> Float[Array, ""]:
    """The discriminator's loss: mean of max(0, 1 - x) on real, max(0, 1 + x) on fake; mean over scales."""
    sign = 1.0 if side == "real" else -1.0
    return sum(jnp.maximum(0.0, 1 - sign * logits).mean() for logits, _ in judgement) / len(judgement)


def adversarial(judgement: Judgement) -> Float[Array, ""]:
    """The generator's side of the hinge loss: minus the mean logit; mean over scales."""
    return -sum(logits.mean() for logits, _ in judgement) / len(judgement)


def feature_matching(fake: Judgement, real: Judgement) -> Float[Array, ""]:
    """Mean absolute differences of the discriminator's features, summed over layers, mean over scales."""
    total = sum(
        jnp.abs(f - jax.lax.stop_gradient(r)).mean()
        for (_, fakes), (_, reals) in zip(fake, real, strict=True)
        for f, r in zip(fakes, reals, strict=True)
    )
    return total / len(fake)


def reconstruction(
    image: Float[Array, "b h w k"], target: Float[Array, "b h w k"], weight: Float[Array, "b h w"]
) -> Float[Array, ""]:
    """Weighted mean absolute error of intensity 0..1 (half the difference of images in [-1, 1])."""
    error = 0.5 * jnp.abs(image - target).mean(-1)
    return (weight * error).sum() / jnp.maximum(weight.sum(), jnp.finfo(error.dtype).tiny)
