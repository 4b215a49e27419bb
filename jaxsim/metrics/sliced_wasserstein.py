"""Sliced Wasserstein distance between patches of two sets of images, level by level of a Laplacian pyramid.

Karras et al. 2018, in the form of dusty-gan-v2 (`gans/metrics/swd.py`): 7 x 7 patches at 128 random places of an
image, each channel standardised over its set, 4 x 128 random directions, each divided by its own standard deviation
(so values are sqrt(49 c) times those of unit directions), mean absolute difference of sorted projections.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxsim.frame import Array
from jaxsim.products import matmul

PATCH = 7
PLACES = 128
REPEATS = 4
TOGETHER = 128
PROJECTIONS = 128
# Binomial taps, which approach a Gaussian (Burt and Adelson 1983).
KERNEL = np.array([1, 4, 6, 4, 1]) / 16


def _blurred(images: Float[Array, "b h w c"], *, stride: int = 1) -> Float[Array, "b _h _w c"]:
    """Five taps along both sides, reflected at the border."""
    for axis in (1, 2):
        padded = jnp.pad(images, [(2, 2) if a == axis else (0, 0) for a in range(4)], mode="reflect")
        size = images.shape[axis]
        images = sum(
            float(tap) * jax.lax.slice_in_dim(padded, k, k + size, stride=stride, axis=axis)
            for k, tap in enumerate(KERNEL)
        )
    return images


def _doubled(images: Float[Array, "b h w c"]) -> Float[Array, "b _h _w c"]:
    """Each cell at the odd place of a new pair of rows and columns, zeros between, blurred to the same brightness."""
    for axis in (1, 2):
        images = jnp.stack([jnp.zeros_like(images), images], axis + 1).reshape(
            *images.shape[:axis], 2 * images.shape[axis], *images.shape[axis + 1 :]
        )
    return 4 * _blurred(images)


def pyramid_levels(rows: int, columns: int) -> int:
    """Levels of the pyramid: halved while the shorter side keeps 16 cells."""
    return int(np.log2(max(min(rows, columns) // 16, 1)) + 1)


@partial(jax.jit, static_argnames="levels")
def laplacian_pyramid(images: Float[Array, "b h w c"], *, levels: int) -> list[Float[Array, "b _h _w c"]]:
    """What each halving loses, finest first; the last is the coarsest image itself."""
    pyramid = [images]
    for _ in range(levels - 1):
        pyramid.append(_blurred(pyramid[-1], stride=2))
        pyramid[-2] = pyramid[-2] - _doubled(pyramid[-1])
    return pyramid


@jax.jit
def patches_at(image: Float[Array, "b h w c"], place: Int[Array, " k"]) -> Float[Array, "b k 7 7 c"]:
    """Patches whose upper-left cell is the `place`-th of those where a whole patch fits."""
    across = image.shape[2] - PATCH + 1
    row, column = place // across, place % across
    step = jnp.arange(PATCH)
    rows = row[:, None, None] + step[None, :, None]
    columns = column[:, None, None] + step[None, None, :]
    return image[:, rows, columns]


@jax.jit
def _standardised(patches: Float[Array, "n k 7 7 c"]) -> Float[Array, "m d"]:
    # Each set by its own, as the program has it: what is brighter as a whole is no distance.
    mean = patches.mean((0, 1, 2, 3), keepdims=True)
    spread = jnp.std(patches, axis=(0, 1, 2, 3), ddof=1, keepdims=True)
    return ((patches - mean) / (spread + 1e-8)).reshape(-1, PATCH * PATCH * patches.shape[-1])


@jax.jit
def sliced(a: Float[Array, "m d"], b: Float[Array, "m d"], directions: Float[Array, "d k"]) -> Float[Array, ""]:
    """Mean absolute difference of the sorted projections on each direction."""
    return jnp.abs(jnp.sort(matmul(a, directions), axis=0) - jnp.sort(matmul(b, directions), axis=0)).mean()


def _distances(a: Sequence[Array], b: Sequence[Array], key: Array) -> list[float]:
    """Distances between the patches (n, k, 7, 7, c) of two sets, one a set of random directions."""
    x = _standardised(jnp.concatenate(a))
    y = _standardised(jnp.concatenate(b))
    distances = []
    for repeat in range(REPEATS):
        directions = jax.random.normal(jax.random.fold_in(key, repeat), (x.shape[1], PROJECTIONS))
        # By their deviation, not their length, as the program has it: values are sqrt(49 c) times larger.
        directions = directions / jnp.std(directions, axis=0, ddof=1, keepdims=True)
        distances.append(float(sliced(x, y, directions)))
    return distances


@runtime_checkable
class Images(Protocol):
    """Images (n, h, w, c): an array, or what reads them when a batch is asked for."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, chosen: slice, /) -> np.ndarray: ...


def sliced_wasserstein(a: Images, b: Images) -> dict[str, float]:
    """`swd_16`, `swd_32`, ... from the finest level on, and `swd_mean`; usually given times 1000.

    Of the images patches alone are kept. Sets must hold equally many images of one size, at least 16 x 16. The places
    of the patches are those of a batch and the same in both sets. Raises ValueError otherwise.
    """
    if a.shape != b.shape:
        raise ValueError(f"swd: sets are {a.shape} and {b.shape}; give equally many images of one size")
    n, rows, columns, _ = a.shape
    if min(rows, columns) < 16:
        raise ValueError(f"swd: images have {rows} x {columns} cells; it needs 16 or more on each side")
    levels, key = pyramid_levels(rows, columns), jax.random.key(0)
    # Halving and doubling must give the same size: what is left over at the lower right is cut.
    multiple = 2 ** (levels - 1)
    height, width = rows // multiple * multiple, columns // multiple * multiple
    patches: list[tuple[list[Array], list[Array]]] = [([], []) for _ in range(levels)]
    for first in range(0, n, TOGETHER):
        parts = [np.asarray(images[first : first + TOGETHER][:, :height, :width], np.float32) for images in (a, b)]
        pyramids = [laplacian_pyramid(part, levels=levels) for part in parts]
        for level, pair in enumerate(zip(*pyramids, strict=True)):
            rows, columns = pair[0].shape[1:3]
            corners = (rows - PATCH + 1) * (columns - PATCH + 1)
            order = jax.random.permutation(jax.random.fold_in(key, level * n + first), corners)
            for side, image in enumerate(pair):
                patches[level][side].append(patches_at(image, order[:PLACES]))
    scores = {}
    for level, sides in enumerate(patches):
        # 2^30 keeps the keys of directions apart from those of places, level n + first.
        distances = _distances(*sides, jax.random.fold_in(key, 2**30 + level))
        scores[f"swd_{16 << level}"] = float(np.mean(distances))
    return scores | {"swd_mean": float(np.mean(list(scores.values())))}
