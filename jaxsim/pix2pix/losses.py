"""Loss terms, each a scalar: as Imaginaire's `losses/` has them, and as NVIDIA/pix2pixHD has them (`original`).

The perceptual one compares features of VGG-19's first thirteen convolutions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from jaxsim.config import QUANTILES, Pix2PixForm
from jaxsim.files import placed
from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import conv2d
from jaxsim.pix2pix.layers import statistics_type
from jaxsim.weights import Converter, checked_arrays, kernel_of, read_state_dict

LossWeights = dict[str, Array]
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


def discriminator_loss(fake: Judgement, real: Judgement, form: Pix2PixForm) -> Float[Array, ""]:
    """What the discriminator learns from, in a published program's form."""
    if form == "original":
        return 0.5 * (least_squares(real, "real") + least_squares(fake, "fake"))
    return hinge(real, "real") + hinge(fake, "fake")


def generator_terms(fake: Judgement, real: Judgement, form: Pix2PixForm) -> dict[str, Float[Array, ""]]:
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
    return _weighted_mean(0.5 * jnp.abs(image - target).mean(-1), weight, mean)


def _weighted_mean(
    loss: Float[Array, "b h w"], weight: Float[Array, "b h w"], mean: Callable[[Array], Array]
) -> Float[Array, ""]:
    # Without any weight the term is 0, not 0 / 0.
    return (weight * loss).sum() / jnp.maximum(mean(weight.sum()), jnp.finfo(loss.dtype).tiny)


def quantile_loss(
    outputs: Float[Array, "b h w k"],
    intensity: Float[Array, "b h w"],
    weight: Float[Array, "b h w"],
    *,
    mean: Callable[[Array], Array] = lambda x: x,
) -> Float[Array, ""]:
    """Weighted pinball losses of the QUANTILES that `outputs` (in [-1, 1]) begin with, summed (Koenker & Bassett 1978).

    The median's is the absolute error; each other quantile's has half its scale, so that the median decides. `mean` as
    in `reconstruction`.
    """
    error = intensity[..., None] - (outputs[..., : len(QUANTILES)] + 1) / 2
    quantile = jnp.asarray(QUANTILES, jnp.float32)[None, None, None]
    share = jnp.where(quantile == 0.5, 2.0, 0.5)
    loss = (share * jnp.maximum(quantile * error, (quantile - 1) * error)).sum(-1)
    return _weighted_mean(loss, weight, mean)


def drop_loss(
    outputs: Float[Array, "b h w k"],
    dropped: Bool[Array, "b h w"],
    weight: Float[Array, "b h w"],
    *,
    mean: Callable[[Array], Array] = lambda x: x,
) -> Float[Array, ""]:
    """Weighted cross entropy, in nats, of the drop whose logit `outputs` end with."""
    logit = outputs[..., -1]
    # From the logit: a probability that rounds to 0 or 1 would have no logarithm.
    loss = jax.nn.softplus(logit) - jnp.where(dropped, logit, jnp.zeros_like(logit))
    return _weighted_mean(loss, weight, mean)


VGG_BLOCKS = ((0, 2), (5, 7), (10, 12, 14, 16), (19, 21, 23, 25), (28,))
"""Places of the convolutions in torchvision's `features`; a 2 x 2 max-pool between the blocks. The ReLU after
the first convolution of each block is a feature of the loss: relu_1_1 ... relu_5_1."""
# Wang et al. 2018: deep features, which say what is there, count more than edges and spots.
LAYER_WEIGHTS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1.0)
# Of ImageNet's colours, red first, as torchvision gives them.
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


def _shapes() -> dict[str, tuple[int, ...]]:
    """torchvision's names and shapes."""
    shapes: dict[str, tuple[int, ...]] = {}
    channels = 3
    for block, places in enumerate(VGG_BLOCKS):
        width = min(64 * 2**block, 512)
        for layer in places:
            shapes[f"features.{layer}.weight"] = (width, channels, 3, 3)
            shapes[f"features.{layer}.bias"] = (width,)
            channels = width
    return shapes


VGG19 = Converter(
    "VGG-19 of torchvision",
    "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth",
    lambda arrays: checked_arrays(arrays, _shapes()),
    digest="dcbb9e9d",
)
"""What `jaxsim convert vgg19` makes of the published weights."""
HOW_TO_GET = (
    f"fetch torchvision's VGG-19 ({VGG19.fetch}), convert it with `jaxsim convert vgg19 vgg19-dcbb9e9d.pth --out "
    "vgg19.npz` and pass --loss.vgg-weights vgg19.npz; or leave the term out with --loss.perceptual 0"
)


def load_vgg(path: Path | None) -> LossWeights:
    """Weights from a .npz of torchvision's names (`features.0.weight`, out x in x 3 x 3), as kernels.

    Raises FileNotFoundError where there is no file, ValueError where an array is missing or misshapen.
    """
    if path is None or not path.is_file():
        missing = "it needs VGG-19 weights" if path is None else f"no VGG-19 weights at {path}"
        raise FileNotFoundError(f"perceptual loss: {missing}; {HOW_TO_GET}")
    with placed(f"perceptual loss: {path}", then=HOW_TO_GET):
        arrays = VGG19.convert(read_state_dict(path))
    return {name: kernel_of(array) if array.ndim == 4 else array for name, array in arrays.items()}


def vgg_features(
    weights: LossWeights, image: Float[Array, "b h w k"], *, imagenet: bool = True
) -> list[Float[Array, "b _h _w _c"]]:
    """relu_1_1, 2_1, 3_1, 4_1, 5_1 of an image in [-1, 1] of 3 channels, or of 1 repeated.

    `imagenet` gives the colours the mean and deviation that the weights were trained with; NVIDIA/pix2pixHD does not.
    Convolutions run in the image's type.
    """
    if image.shape[-1] == 1:
        image = jnp.repeat(image, 3, axis=-1)
    mean = jnp.asarray(MEAN, image.dtype)[None, None, None]
    deviation = jnp.asarray(DEVIATION, image.dtype)[None, None, None]
    # The mean and deviation are of images in 0..1.
    x = ((image + 1) / 2 - mean) / deviation if imagenet else image
    features = []
    for block, places in enumerate(VGG_BLOCKS):
        if block:
            x = jax.lax.reduce_window(x, -jnp.inf, jax.lax.max, (1, 2, 2, 1), (1, 2, 2, 1), "VALID")
        for i, layer in enumerate(places):
            kernel = jnp.asarray(weights[f"features.{layer}.weight"], x.dtype)
            bias = jnp.asarray(weights[f"features.{layer}.bias"], x.dtype)
            x = conv2d(x, kernel, padding="zero") + bias[None, None, None]
            x = jax.nn.relu(x)
            if i == 0:
                features.append(x)
    return features


def perceptual(
    weights: LossWeights,
    image: Float[Array, "b h w k"],
    target: Float[Array, "b h w k"],
    *,
    imagenet: bool = True,
    compute: Any = None,
) -> Float[Array, ""]:
    """Mean absolute differences of VGG features, weighted 1/32, 1/16, 1/8, 1/4, 1; target held fixed.

    `compute` is the type in which the convolutions run, by default the image's.
    """
    if compute is not None:
        image, target = image.astype(compute), target.astype(compute)
    seen = vgg_features(weights, image, imagenet=imagenet)
    wanted = vgg_features(weights, target, imagenet=imagenet)
    # Only the image learns: features of the target are held (`mean_difference`).
    terms = [mean_difference(a, b) for a, b in zip(seen, wanted, strict=True)]
    return sum(w * term for w, term in zip(LAYER_WEIGHTS, terms, strict=True))
