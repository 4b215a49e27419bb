"""Fréchet distance over features of range images: RangeNet++ (Milioto et al. 2019) with the Darknet-53 backbone.

LiDARGen's FRD (`metrics/fid`): the decoder's last map of a 64 x 1024 image, of whose 32 x 64 x 1024 values 4096
are taken at random, always the same. With fewer scans than 4096 the covariances are singular, there as here: compare
values at one number of scans alone. Published code loses the scan's first point; it is kept here.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import Array
from jaxsim.metrics.bev import SCAN_COLUMNS, SCAN_ROWS, spherical_image
from jaxsim.products import PRECISION
from jaxsim.weights import Arrays, Converter, checked_arrays, kernel_of, load_weights

ENCODER_BLOCKS = (1, 2, 8, 8, 4)
"""Residual blocks of each of the five encoder stages."""
WIDTH = 32
"""Channels of the first layer; each stage doubles them."""
MEANS = (12.12, 10.88, 0.23, -1.04, 0.21)
DEVIATIONS = (12.32, 11.47, 6.91, 0.86, 0.16)
"""Of range, x, y, z (m) and remission: arch_cfg.yaml of the published model."""
FEATURE_WIDTH = 4096
BATCH_NORM_EPS, SLOPE = 1e-5, 0.1
STATE_DICTS = ("backbone", "segmentation_decoder")
NORM = ("weight", "bias", "running_mean", "running_var")


def layers(width: int = WIDTH, blocks: tuple[int, ...] = ENCODER_BLOCKS) -> dict[str, tuple[tuple[int, ...], str]]:
    """Published name of every convolution -> (shape of its weight, name of the batch norm behind it)."""
    encoder, decoder = STATE_DICTS
    shapes: dict[str, tuple[tuple[int, ...], str]] = {f"{encoder}.conv1": ((width, 5, 3, 3), f"{encoder}.bn1")}

    def residual(name: str, outer: int, inner: int) -> None:
        shapes[f"{name}.conv1"] = ((inner, outer, 1, 1), f"{name}.bn1")
        shapes[f"{name}.conv2"] = ((outer, inner, 3, 3), f"{name}.bn2")

    for i, count in enumerate(blocks):
        narrow = width << i
        wide = width << (i + 1)
        stage = f"{encoder}.enc{i + 1}"
        shapes[f"{stage}.conv"] = ((wide, narrow, 3, 3), f"{stage}.bn")
        for k in range(count):
            residual(f"{stage}.residual_{k}", wide, narrow)
    for i in range(len(blocks), 0, -1):
        narrow = width << (i - 1)
        wide = width << i
        stage = f"{decoder}.dec{i}"
        shapes[f"{stage}.upconv"] = ((wide, narrow, 1, 4), f"{stage}.bn")  # transposed: in, out
        residual(f"{stage}.residual", narrow, wide)
    return shapes


def published_shapes(width: int = WIDTH, blocks: tuple[int, ...] = ENCODER_BLOCKS) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the published state dicts, each with its file's name before it."""
    shapes: dict[str, tuple[int, ...]] = {}
    for name, (shape, norm) in layers(width, blocks).items():
        up = name.endswith("upconv")
        shapes[f"{name}.weight"] = shape
        if up:
            shapes[f"{name}.bias"] = (shape[1],)
        shapes |= {f"{norm}.{part}": (shape[1] if up else shape[0],) for part in NORM}
    return shapes


CONVERTER = Converter(
    "RangeNet++ with Darknet-53 at 64 x 1024",
    "http://www.ipb.uni-bonn.de/html/projects/bonnetal/lidar/semantic/models/darknet53-1024.tar.gz and unpack it: FILE "
    "is its folder",
    lambda arrays: checked_arrays(arrays, published_shapes()),
    files=STATE_DICTS,
)
"""What `jaxsim convert rangenet53` makes of the published folder."""

Kernels = dict[str, tuple[Array, Array]]
"""Kernel (rows, columns, in, out) and bias of every convolution, batch norm folded in."""


def fold_batch_norm(arrays: Arrays, width: int = WIDTH, blocks: tuple[int, ...] = ENCODER_BLOCKS) -> Kernels:
    """Values of the network from the published arrays."""
    values: Kernels = {}
    for name, (_, norm) in layers(width, blocks).items():
        stored = {part: arrays[f"{norm}.{part}"].astype(np.float64) for part in NORM}
        scale = stored["weight"] / np.sqrt(stored["running_var"] + BATCH_NORM_EPS)
        shift = stored["bias"]
        weight = arrays[f"{name}.weight"]
        up = name.endswith("upconv")
        kernel, bias = kernel_of(weight, transposed=up), arrays[f"{name}.bias"] if up else np.zeros_like(shift)
        # (conv(x) + bias - mean) scale + shift, as one convolution and one bias.
        values[name] = (
            (kernel * scale).astype(np.float32),
            (shift + (bias - stored["running_mean"]) * scale).astype(np.float32),
        )
    return values


def _layer(values: Kernels, name: str, x: Array, *, stride: int = 1) -> Array:
    """Convolution and leaky ReLU; `upconv` doubles the columns, `stride` thins them."""
    kernel, bias = jax.tree.map(jnp.asarray, values[name])
    convolve = partial(jax.lax.conv_general_dilated, dimension_numbers=("NHWC", "HWIO", "NHWC"), precision=PRECISION)
    if name.endswith("upconv"):
        # Columns are doubled: zeros between, and 2 on both sides for the kernel of 4.
        x = convolve(x, kernel, (1, 1), ((0, 0), (2, 2)), lhs_dilation=(1, 2))
    else:
        half = kernel.shape[0] // 2
        x = convolve(x, kernel, (1, stride), ((half, half), (half, half)))
    return jax.nn.leaky_relu(x + bias[None, None, None], SLOPE)


@partial(jax.jit, static_argnames="blocks")
def decoder_map(
    values: Kernels, image: Float[Array, "b h w 5"], *, blocks: tuple[int, ...] = ENCODER_BLOCKS
) -> Float[Array, "b h w c"]:
    """The decoder's last map, 32 channels at full size; columns must divide by 32."""
    encoder, decoder = STATE_DICTS

    def residual(name: str, x: Array) -> Array:
        return x + _layer(values, f"{name}.conv2", _layer(values, f"{name}.conv1", x))

    x = _layer(values, f"{encoder}.conv1", image)
    skips = []
    for i, count in enumerate(blocks):
        skips.append(x)
        x = _layer(values, f"{encoder}.enc{i + 1}.conv", x, stride=2)
        for k in range(count):
            x = residual(f"{encoder}.enc{i + 1}.residual_{k}", x)
    for i in range(len(blocks), 0, -1):
        x = residual(f"{decoder}.dec{i}.residual", _layer(values, f"{decoder}.dec{i}.upconv", x)) + skips.pop()
    return x


@jax.jit
def network_image(
    xyz_m: Float[Array, "b n 3"], remission: Float[Array, "b n"], valid: Bool[Array, "b n"]
) -> Float[Array, "b 64 1024 5"]:
    """Range, x, y, z and remission of the nearest point in each cell, standardised; 0 where there is none."""
    range_m, filled, index = spherical_image(xyz_m, valid)
    flat = index.reshape(index.shape[0], -1)

    def picked(values: Array) -> Array:
        return jnp.take_along_axis(values, flat, axis=1).reshape(index.shape)

    # In the order in which the published network was given them.
    channels = jnp.stack([range_m, *(picked(xyz_m[..., i]) for i in range(3)), picked(remission)], -1)
    mean = jnp.asarray(MEANS, jnp.float32)[None, None, None]
    deviation = jnp.asarray(DEVIATIONS, jnp.float32)[None, None, None]
    return jnp.where(filled[..., None], (channels - mean) / deviation, 0.0)


@cache
def _chosen() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns and channels of the 4096 values: LiDARGen's draw from the map flattened channel by channel."""
    # Python's own generator with seed 0, as the program has it: any other draws other values.
    places = np.array(random.Random(0).sample(range(WIDTH * SCAN_ROWS * SCAN_COLUMNS), FEATURE_WIDTH))
    channel, row, column = np.unravel_index(places, (WIDTH, SCAN_ROWS, SCAN_COLUMNS))
    return row, column, channel


def range_features(
    values: Kernels,
    scans: Iterable[tuple[Float[np.ndarray, "b n 3"], Float[np.ndarray, "b n"], Bool[np.ndarray, "b n"]]],
) -> Float[np.ndarray, "m 4096"]:
    """LiDARGen's features of scans that arrive in batches of points, remissions (0..1) and which are real."""
    row, column, channel = _chosen()
    maps = (np.asarray(decoder_map(values, network_image(*scan))) for scan in scans)
    return np.concatenate([decoded[:, row, column, channel] for decoded in maps])


def load_rangenet(path: Path) -> Kernels:
    """Values from a converted file. Raises FileNotFoundError or ValueError, which say what to fetch and convert."""
    weights = load_weights(path, "rangenet53", CONVERTER)
    values: Any = jax.tree.map(jnp.asarray, fold_batch_norm(weights.arrays))
    return values
