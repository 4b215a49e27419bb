"""Loss terms, each a scalar: as Imaginaire's `losses/` has them, and as NVIDIA/pix2pixHD has them (`original`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.config import Form
from jaxsim.pix2pix.normalisation import statistics_type

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


def least_squares(judgement: Judgement, side: Literal["real", "fake"]) -> Float[Array, ""]:
    """Mean squared distance of the logits from 1 (real) or 0 (fake), summed over scales.

    The generator's side is that of its images from `real`. Mao et al. 2017; NVIDIA/pix2pixHD `GANLoss`.
    """
    aim = 1.0 if side == "real" else 0.0
    return sum(jnp.square(logits - aim).mean() for logits, _ in judgement)


def feature_matching(fake: Judgement, real: Judgement) -> Float[Array, ""]:
    """Mean absolute differences of the discriminator's features, summed over layers, mean over scales."""
    total = sum(
        mean_difference(f, r)
        for (_, fakes), (_, reals) in zip(fake, real, strict=True)
        for f, r in zip(fakes, reals, strict=True)
    )
    return total / len(fake)


def mean_difference(x: Float[Array, "*shape"], held: Float[Array, "*shape"]) -> Float[Array, ""]:
    """Mean absolute difference from features that are held fixed; the mean is taken in float32 at least."""
    return jnp.abs(x - jax.lax.stop_gradient(held)).mean(dtype=statistics_type(x))


def discriminator_loss(fake: Judgement, real: Judgement, form: Form) -> Float[Array, ""]:
    """What the discriminator learns from, in a published program's form."""
    if form == "original":
        return 0.5 * (least_squares(real, "real") + least_squares(fake, "fake"))
    return hinge(real, "real") + hinge(fake, "fake")


def generator_terms(fake: Judgement, real: Judgement, form: Form) -> dict[str, Float[Array, ""]]:
    """The generator's terms that the discriminator gives, unweighted: `gan` and `feature_matching`."""
    if form == "original":
        # 4 / (n_layers + 1) there, whose features are the n_layers + 1 layers before the logits.
        share = 4 / len(fake[0][1])
        return {"gan": least_squares(fake, "real"), "feature_matching": share * feature_matching(fake, real)}
    return {"gan": adversarial(fake), "feature_matching": feature_matching(fake, real)}


def reconstruction(
    image: Float[Array, "b h w k"],
    target: Float[Array, "b h w k"],
    weight: Float[Array, "b h w"],
    *,
    mean: Callable[[Array], Array] = lambda x: x,
) -> Float[Array, ""]:
    """Weighted mean absolute error of intensity 0..1 (half the difference of images in [-1, 1]).

    Where devices share a batch, `mean` takes the mean over them: weights are told from those of the whole batch,
    so that the mean of the devices' terms is the term of the whole.
    """
    error = 0.5 * jnp.abs(image - target).mean(-1)
    return (weight * error).sum() / jnp.maximum(mean(weight.sum()), jnp.finfo(error.dtype).tiny)
