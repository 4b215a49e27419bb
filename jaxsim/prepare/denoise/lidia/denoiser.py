"""LIDIA on whole images: two scales of patches, their neighbours, the network, and the patches put together again."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Bool, Float

from jaxsim.frame import Array
from jaxsim.prepare.denoise.lidia.network import PatchDenoiser, Scale, Variant
from jaxsim.prepare.denoise.lidia.patches import RADIUS, blur, fold, nearest_patches, pad, unfold
from jaxsim.prepare.denoise.lidia.stages import BLOCK, Statistics
from jaxsim.products import tensordot
from jaxsim.weights import Values

BEYOND_BORDER = -1.0
"""What stands beyond the mirrored border, where the search finds nothing alike."""
GREY = (0.2989, 0.5870, 0.1140)
CHUNK: dict[Statistics, int] = {"stored": BLOCK, "image": 40_000, "training": 2**30}
"""Patches at a time. With stored statistics a matter of memory alone; of the image's, the published number."""


@cache
def definition(variant: Variant) -> Any:
    """The network without values."""
    return nnx.graphdef(nnx.eval_shape(lambda: PatchDenoiser(variant, nnx.Rngs(0))))


@cache
def abstract(variant: Variant) -> Values:
    """Shapes of a network's values."""
    return nnx.to_pure_dict(nnx.state(nnx.eval_shape(lambda: PatchDenoiser(variant, nnx.Rngs(0)))))


def check_image_size(rows: int, columns: int, variant: Variant) -> None:
    """Raises ValueError where an image is too small to be mirrored at its borders."""
    least = coarse_margin(variant) + 1
    if min(rows, columns) < least:
        raise ValueError(
            f"lidia: the image has {rows} x {columns} cells; the network mirrors {least - 1} of them at each border, "
            f"so it takes at least {least} x {least}; denoise a wider window, or take another method"
        )


def coarse_margin(variant: Variant) -> int:
    """Mirrored cells around an image at the coarse scale: half a patch, its blur, and half a dilated patch."""
    return (variant.p - 1) // 2 + 1 + (variant.p - 1)


@partial(jax.jit, static_argnames=("variant", "statistics", "chunk"))
def apply(
    values: Values,
    image: Float[Array, "b h w c"],
    measured: Bool[Array, "b h w"] | None = None,
    *,
    variant: Variant = Variant(),  # noqa: B008
    statistics: Statistics = "stored",
    chunk: int | None = None,
) -> Float[Array, "b h w c"]:
    """Images in [-1, 1] without noise; not cut to [-1, 1].

    `measured=None`: every cell is, as in the published program. Else cells outside the mask take no part in the search,
    the image's mean, the coarse image and the statistics; inside patches they have the values that `image` gives them,
    so fill them from their surroundings before (`close_gaps`), and what comes back for them means nothing. With
    `statistics="image"` a batch shares one set of statistics, that of all its patches: give images one by one where
    each is to have its own (`Lidia` does).
    """
    return _apply(nnx.merge(definition(variant), values), image, measured, statistics=statistics, chunk=chunk)


def apply_and_learn(
    values: Values, image: Float[Array, "b h w c"], measured: Bool[Array, "b h w"], *, variant: Variant
) -> tuple[Float[Array, "b h w c"], Values]:
    """As `apply` in training: with the statistics of the patches at hand; and the values whose statistics moved."""
    network = nnx.merge(definition(variant), values)
    return _apply(network, image, measured, statistics="training", chunk=None), nnx.to_pure_dict(nnx.state(network))


def _apply(network: PatchDenoiser, image: Array, measured: Array | None, *, statistics: Statistics, chunk: int | None):
    variant = network.variant
    b, h, w, c = image.shape
    if c != variant.channels:
        raise ValueError(f"lidia: the image has {c} channels; these weights are for {variant.channels}")
    if statistics not in CHUNK:
        raise ValueError(f"lidia: no statistics {statistics!r}; known: {', '.join(CHUNK)}")
    check_image_size(h, w, variant)
    p = variant.p
    mean = _mean(image, measured)
    image = image - mean
    fine_image, fine_mask = _bordered(image, measured, p - 1)
    coarse_image, coarse_mask = _blurred(*_bordered(image, measured, coarse_margin(variant)))
    shape = (b, fine_image.shape[1] - p + 1, fine_image.shape[2] - p + 1)
    fine, coarse = _scale(fine_image, fine_mask, p, d=1), _scale(coarse_image, coarse_mask, p, d=2)
    counted = jnp.ones(fine.index.shape[1])
    if fine_mask is not None:  # patches without a measured cell do not count in the statistics
        counted = (unfold(fine_mask, p).sum(-1) > 0).astype(fine_mask.dtype).reshape(-1)
    clean, weight = network(fine, coarse, counted, shape=shape, statistics=statistics, chunk=chunk or CHUNK[statistics])
    # Overlapping patches are averaged by their weights; the mirrored border is cut off again.
    total = fold((clean * weight[:, None]).reshape(*shape, -1), p)
    share = fold(jnp.broadcast_to(weight[:, None], (len(weight), p * p)).reshape(*shape, -1), p)
    inner = slice(p - 1, 1 - p)
    return (total / share)[:, inner, inner] + mean


def _mean(image: Array, measured: Array | None) -> Array:
    if measured is None:
        return image.mean((1, 2), keepdims=True)
    weight = measured[..., None].astype(image.dtype)
    return (image * weight).sum((1, 2), keepdims=True) / jnp.maximum(weight.sum((1, 2), keepdims=True), 1.0)


def _bordered(image: Array, measured: Array | None, margin: int) -> tuple[Array, Array | None]:
    mask = None if measured is None else pad(measured[..., None].astype(image.dtype), margin, "reflect")
    return pad(image, margin, "reflect"), mask


def _blurred(image: Array, mask: Array | None) -> tuple[Array, Array | None]:
    """The coarse image: of measured cells alone, where there are any in the 3 x 3."""
    if mask is None:
        return blur(image), None
    weight = blur(mask)
    known = weight > 0
    return jnp.where(known, blur(image * mask) / jnp.where(known, weight, 1.0), blur(image)), known.astype(image.dtype)


def _scale(image: Array, mask: Array | None, p: int, *, d: int) -> Scale:
    """Table of patches, neighbours and distances of every patch of `image`."""
    margin, (b, _, _, c) = RADIUS * d, image.shape
    outer = pad(image, margin, "constant", value=BEYOND_BORDER)
    known = None if mask is None else pad(mask, margin, "constant", value=1.0)
    grey = outer[..., 0] if c == 1 else tensordot(outer, jnp.asarray(GREY), 1)
    table = unfold(outer, p, d)
    search = partial(nearest_patches, p=p, d=d)
    if known is None:
        distance, index = jax.lax.map(lambda one: search(one, None), grey)
    else:
        distance, index = jax.lax.map(lambda one: search(*one), (grey, known[..., 0] > 0))
    # The table holds the patches of all images: each image's numbers begin where the one before ends.
    index = index + (jnp.arange(b) * (table.shape[1] * table.shape[2]))[:, None, None, None]
    variance = _variance(unfold(image, p, d), None if mask is None else unfold(jnp.repeat(mask, c, -1), p, d))
    distance = jnp.concatenate([distance[..., 1:], variance], -1)
    flat = lambda x: x.reshape(-1, x.shape[-1])  # noqa: E731
    return Scale(flat(table), flat(index).T, flat(distance).T)


def _variance(patches: Array, mask: Array | None) -> Array:
    """Unbiased variance of each patch times its number of values."""
    numel = patches.shape[-1]
    if mask is None:
        return numel * jnp.var(patches, -1, ddof=1, keepdims=True)
    number = mask.sum(-1, keepdims=True)
    mean = (patches * mask).sum(-1, keepdims=True) / jnp.maximum(number, 1.0)
    return numel * ((patches - mean) ** 2 * mask).sum(-1, keepdims=True) / jnp.maximum(number - 1.0, 1.0)
