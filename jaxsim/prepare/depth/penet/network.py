"""PENet: a colour-dominant and a depth-dominant branch (ENet), fused, and refined by DA-CSPN++.

Hu, Wang, Li, Nie, Liu, Wang: PENet, Towards Precise and Efficient Image Guided Depth Completion, ICRA 2021; layer plan
of JUGGHM/PENet_ICRA2021 `model.py` (PENet_C2, encoding xyz), whose names the modules bear.

Coordinates of the cells of a sparse depth image, at every scale, are vertical, horizontal, depth, in metres; 0 where a
cell holds no point. `exact`: u, v are a cell's mean pixel coordinates. `published`: as the published program has them,
with which its weights were trained: a cell's place runs from 0 to the *scaled-down* size 352 x 1216, less the
*full-size* principal point, whatever the image's size.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import Bool, Float, Real

from jaxsim.frame import Array
from jaxsim.prepare.depth.penet.layers import KERNELS, ConvBn, Deconv, GeoBlock, Guide, Mode, from_neighbours, propagate

Convention = Literal["exact", "published"]
PUBLISHED_SIZE = (352, 1216)
SCALES = 5
MULTIPLE = 2**SCALES
"""Rows and columns must divide by this."""
PUBLISHED_WIDTH = 32


def nearest_of_four(
    depth_m: Float[Array, "b h w"], valid: Bool[Array, "b h w"]
) -> tuple[Float[Array, "b h/2 w/2"], Bool[Array, "b h/2 w/2"]]:
    """Half the rows and columns: the nearest valid depth of each 2 x 2, and whether there is one."""
    far = jnp.where(valid, depth_m, jnp.inf)
    b, h, w = depth_m.shape
    nearest = far.reshape(b, h // 2, 2, w // 2, 2).min((2, 4))
    known = jnp.isfinite(nearest)
    return jnp.where(known, nearest, 0.0), known


def coordinates(
    depth_m: Float[Array, "b h w"],
    valid: Bool[Array, "b h w"],
    intrinsics: Float[Array, "b 3 3"],
    *,
    scales: int,
    convention: Convention,
) -> list[Float[Array, "b _h _w 3"]]:
    """Coordinates of the image's cells and of its halvings, `scales` rasters, the finest first."""
    places = [_places(size, scales) for size in depth_m.shape[1:]]
    focal = jnp.diagonal(intrinsics, axis1=1, axis2=2)[..., None, None]
    centre = intrinsics[:, :, 2][..., None, None]
    result = []
    for k in range(scales):
        across = [along[k] for along in places]
        if convention == "published":
            # From -1 to 1 over the image, averaged two by two.
            across = [
                0.5 * full / 2**k * (2 * along[k] / along[0][-1])
                for full, along in zip(PUBLISHED_SIZE, places, strict=True)
            ]
        v = jnp.asarray(across[0], jnp.float32)[None, :, None]
        u = jnp.asarray(across[1], jnp.float32)[None, None, :]
        z = jnp.where(valid, depth_m, 0.0)
        # The pinhole camera inverted at depth z.
        down = z * (v - centre[:, 1]) / focal[:, 1]
        right = z * (u - centre[:, 0]) / focal[:, 0]
        result.append(jnp.stack([down, right, z], -1))
        if k + 1 < scales:
            depth_m, valid = nearest_of_four(depth_m, valid)
    return result


def _places(size: int, scales: int) -> list[np.ndarray]:
    """Mean pixel coordinate of each cell along one axis, for every scale."""
    places = [np.arange(size, dtype=np.float64)]
    for _ in range(scales - 1):
        places.append(places[-1].reshape(-1, 2).mean(1))
    return places


def twice(x: Float[Array, "b h w *c"]) -> Float[Array, "b _h _w *c"]:
    """Twice the rows and columns, each cell repeated."""
    return jnp.repeat(jnp.repeat(x, 2, 1), 2, 2)


class Backbone(NamedTuple):
    """What the two branches give."""

    colour: Float[Array, "b h w"]
    """Depth of the colour-dominant branch, metres."""
    depth: Float[Array, "b h w"]
    """Depth of the depth-dominant branch."""
    fused: Float[Array, "b h w"]
    logits: Float[Array, "b h w 2"]
    """Confidence in each, before the softmax."""
    fine: Float[Array, "b h w c"]
    """Features for the refinement, at full and at half size."""
    coarse: Float[Array, "b h/2 w/2 k"]


class ENet(nnx.Module):
    """Both branches. `width` channels in the first layer; every halving doubles them."""

    def __init__(self, width: int, rngs: nnx.Rngs):
        w = [width * 2**k for k in range(SCALES + 1)]
        # Colour and sparse depth; sparse depth and the first branch's guess.
        self.rgb_conv_init = ConvBn(4, width, 5, relu=True, rngs=rngs)
        self.depth_conv_init = ConvBn(2, width, 5, relu=True, rngs=rngs)
        for k in range(SCALES):
            # From the second stage on, the depth branch also sees the colour decoder's features.
            beside = w[k] if k == 0 else 2 * w[k]
            for name, inputs in (("rgb_encoder_layer", w[k]), ("depth_layer", beside)):
                setattr(self, f"{name}{2 * k + 1}", GeoBlock(inputs, w[k + 1], stride=2, rngs=rngs))
                setattr(self, f"{name}{2 * k + 2}", GeoBlock(w[k + 1], w[k + 1], stride=1, rngs=rngs))
            setattr(self, f"rgb_decoder_layer{2 * k}", Deconv(w[k + 1], w[k], rngs=rngs))
            setattr(self, f"decoder_layer{SCALES - k}", Deconv(w[k + 1], w[k], rngs=rngs))
        self.rgb_decoder_output = Deconv(width, 2, 3, stride=1, rngs=rngs)
        self.decoder_layer6 = ConvBn(width, 2, relu=True, rngs=rngs)

    def __call__(
        self, rgb: Float[Array, "b h w 3"], sparse: Float[Array, "b h w"], geo: list[Array], *, train: Mode
    ) -> Backbone:
        sparse = sparse[..., None]

        def encode(name: str, k: int, x: Array) -> Array:
            x = getattr(self, f"{name}{2 * k + 1}")(x, geo[k], geo[k + 1], train=train)
            return getattr(self, f"{name}{2 * k + 2}")(x, geo[k + 1], geo[k + 1], train=train)

        colour = [self.rgb_conv_init(jnp.concatenate([rgb, sparse], -1), train=train)]
        for k in range(SCALES):
            colour.append(encode("rgb_encoder_layer", k, colour[k]))
        decoded = {SCALES: colour[SCALES]}
        for k in reversed(range(SCALES)):
            # Skips are added, as in ENet, where a U-Net would concatenate.
            decoded[k] = getattr(self, f"rgb_decoder_layer{2 * k}")(decoded[k + 1], train=train) + colour[k]
        first = self.rgb_decoder_output(decoded[0], train=train)

        x = self.depth_conv_init(jnp.concatenate([sparse, first[..., :1]], -1), train=train)
        depth = [x]
        for k in range(SCALES):
            depth.append(encode("depth_layer", k, depth[k] if k == 0 else jnp.concatenate([decoded[k], depth[k]], -1)))
        x, features = colour[SCALES] + depth[SCALES], {}
        for k in reversed(range(SCALES)):
            features[k] = getattr(self, f"decoder_layer{SCALES - k}")(x, train=train)
            x = features[k] + depth[k]
        second = self.decoder_layer6(features[0], train=train)

        logits = jnp.stack([first[..., 1], second[..., 1]], -1)
        share = jax.nn.softmax(logits, -1)  # each branch counts by its confidence against the other's
        fused = share[..., 0] * first[..., 0] + share[..., 1] * second[..., 0]
        fine = jnp.concatenate([decoded[0], features[0]], -1)
        coarse = jnp.concatenate([decoded[1], features[1]], -1)
        return Backbone(first[..., 0], second[..., 0], fused, logits, fine, coarse)


class PENet(nnx.Module):
    """The whole network. `convention` says how it was told where cells are in space."""

    def __init__(self, width: int, convention: Convention, rngs: nnx.Rngs):
        self.convention: Convention = convention
        self.backbone = ENet(width, rngs)
        for suffix, channels in (("", 2 * width), ("_s2", 4 * width)):
            setattr(self, f"mask_layer{suffix}", ConvBn(channels, 1, rngs=rngs))
            setattr(self, f"kernel_conf_layer{suffix}", ConvBn(channels, len(KERNELS), rngs=rngs))
            for k in KERNELS:
                setattr(self, f"iter_guide_layer{k}{suffix}", Guide(channels, k, rngs=rngs))

    def coarse(
        self,
        rgb: Real[Array, "b h w 3"],
        sparse: Float[Array, "b h w"],
        valid: Bool[Array, "b h w"],
        *,
        intrinsics: Float[Array, "b 3 3"],
        train: Mode,
    ) -> Backbone:
        """Both branches alone. rgb 0..255, sparse depth in metres where `valid`; rows and columns are multiples of
        MULTIPLE (`check_crop`)."""
        geo = coordinates(sparse, valid, intrinsics, scales=SCALES + 1, convention=self.convention)
        return self.backbone(rgb.astype(jnp.float32), jnp.where(valid, sparse, 0.0), geo, train=train)

    def refine(
        self, seen: Backbone, sparse: Float[Array, "b h w"], valid: Bool[Array, "b h w"], *, train: Mode
    ) -> Float[Array, "b h w"]:
        """Six propagations at dilation 2 with guides of half size, then six at full size."""
        half, half_valid = nearest_of_four(sparse, valid)
        depth = seen.fused
        for suffix, features, known, known_valid in (
            ("_s2", seen.coarse, half, half_valid),
            ("", seen.fine, jnp.where(valid, sparse, 0.0), valid),
        ):
            size = twice if suffix else lambda x: x
            logit = getattr(self, f"mask_layer{suffix}")(features, train=train)[..., 0]
            # Measured depths come back after every step, as far as this mask trusts them: KITTI's points are not all
            # right.
            trust = jnp.where(known_valid, jax.nn.sigmoid(logit), 0.0)
            # How much each size of neighbourhood (KERNELS) counts at a pixel.
            confidence = jax.nn.softmax(getattr(self, f"kernel_conf_layer{suffix}")(features, train=train), -1)
            guides = [getattr(self, f"iter_guide_layer{k}{suffix}")(features, train=train) for k in KERNELS]
            depth = propagate(
                [size(from_neighbours(guide)) for guide in guides],
                size(confidence),
                depth,
                sparse=size(known),
                trust=size(trust),
                dilation=2 if suffix else 1,
            )
        return depth
