"""Training LIDIA on images of one's own: the paper's instance adaptation.

*Internal*: the image itself, denoised once, stands for the clean one; noise is added to it anew. *External*: one clean
image of the same kind, or several. Or measured pairs: noisy images and what they should have been. Loss, optimiser,
rates, epochs and blocks are those of grishavak/LIDIA-denoiser `code/*_adaptation_bw.py`, `code/utils.py`. Blocks are
mirrored at their borders as whole images are: the published blocks bring 38 cells of their surroundings along, which a
window of 44 laser lines does not have. An image is learned in memory, in no run of `jaxsim.train`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Bool, Float

from jaxsim.geometry.rasters import close_gaps
from jaxsim.prepare.denoise.lidia import Lidia
from jaxsim.prepare.denoise.lidia.denoiser import apply_and_learn, check_image_size
from jaxsim.prepare.denoise.lidia.network import Variant
from jaxsim.train.in_memory import descend
from jaxsim.weights import RUNNING, Values

_State = tuple[Values, Any]
"""The network's values, and Adam's memory."""


@dataclass(frozen=True)
class Adaptation:
    """Settings of a training on one's own images."""

    noise: float = 25 / 255
    """Standard deviation of the noise that is added to clean images, in intensity (0..1)."""
    lr: float = 1e-3
    epochs: int = 5
    block: int = 64
    """Rows and columns of the blocks; fewer where the image has fewer rows."""
    stride: int = 32
    batch: int = 4
    transpose: bool = True
    """Blocks are also turned, rows for columns. Laser lines are no columns: each has a gain of its own."""
    seed: int = 0


INTERNAL = Adaptation()
EXTERNAL = Adaptation(lr=1e-2, epochs=10)
"""The published settings."""


def adapt_to_itself(
    network: Lidia,
    intensity: Float[np.ndarray, "n rows columns"],
    valid: Bool[np.ndarray, "n rows columns"],
    *,
    settings: Adaptation = INTERNAL,
) -> Lidia:
    """Internal adaptation: the network trained to find its own denoised images again under more noise."""
    return adapt(network, network(intensity, valid), valid, settings=settings)


def adapt(
    network: Lidia,
    clean: Float[np.ndarray, "n rows columns"],
    valid: Bool[np.ndarray, "n rows columns"],
    *,
    settings: Adaptation = EXTERNAL,
    noisy: Float[np.ndarray, "n rows columns"] | None = None,
) -> Lidia:
    """The network after training on clean images (intensity 0..1) with noise added, or on measured pairs.

    Only valid cells count in the loss, log10 of the mean squared error. With `noisy` images no noise is added.
    Raises ValueError where there is no image, none has a valid cell, or they are smaller than the network's border.
    """
    if not len(clean) or not valid.any((1, 2)).all():
        raise ValueError("lidia: nothing to adapt to: give images that each have at least one valid cell")
    side = min(settings.block, *clean.shape[1:])
    check_image_size(side, side, network.variant)
    images = [
        # 0..1 to the network's [-1, 1].
        np.stack([2 * close_gaps(x, v) - 1 for x, v in zip(given, valid, strict=True)])
        for given in (clean, clean if noisy is None else noisy)
    ]
    adam = optax.adam(settings.lr)
    deviation = 2 * settings.noise if noisy is None else 0.0  # images are shown on [-1, 1]: twice the intensity's scale
    key = jax.random.key(settings.seed)

    def step(state: _State, block: tuple[np.ndarray, ...], k: int) -> tuple[_State, jax.Array]:
        form = {"deviation": deviation, "lr": settings.lr, "variant": network.variant}
        return _step(state, block, key=jax.random.fold_in(key, k), **form)

    blocks = _Blocks(images, valid, side, settings=settings)
    values, _ = descend(step, (network.values, adam.init(network.values)), blocks, steps=len(blocks), by="lidia")
    return replace(network, values=values)


class _Blocks:
    """Batches of clean and noisy square blocks and their masks, shuffled, mirrored and transposed at random."""

    def __init__(self, images: list[np.ndarray], valid: np.ndarray, side: int, *, settings: Adaptation):
        self.rasters = (*images, valid)
        self.side = side
        self.settings = settings
        n, rows, columns = valid.shape
        corners = [range(0, size - side + 1, settings.stride) for size in (rows, columns)]
        self.places = [
            np.s_[i, row : row + side, column : column + side]
            for i in range(n)
            for row in corners[0]
            for column in corners[1]
            if valid[i, row : row + side, column : column + side].any()
        ]
        self.batch = min(settings.batch, len(self.places))

    def __len__(self) -> int:
        return self.settings.epochs * (len(self.places) // self.batch)

    def __iter__(self) -> Iterator[tuple[np.ndarray, ...]]:
        for epoch in range(self.settings.epochs):
            rng = np.random.default_rng([self.settings.seed, epoch])
            order = rng.permutation(len(self.places))
            for start in range(0, len(order) - self.batch + 1, self.batch):
                # A coin each: rows mirrored, columns mirrored, rows for columns.
                turns = rng.integers(0, 2, (self.batch, 3)) * np.array([1, 1, self.settings.transpose])
                chosen = zip(order[start : start + self.batch], turns, strict=True)
                blocks = [self._block(int(k), turn) for k, turn in chosen]
                yield tuple(np.stack(column) for column in zip(*blocks, strict=True))

    def _block(self, k: int, turn: np.ndarray) -> list[np.ndarray]:
        parts = [raster[self.places[k]][:: 1 - 2 * turn[0], :: 1 - 2 * turn[1]] for raster in self.rasters]
        return [part.T if turn[2] else part for part in parts]


@partial(jax.jit, static_argnames=("lr", "variant"))
def _step(
    state: _State,
    block: tuple[jax.Array, ...],
    *,
    key: jax.Array,
    deviation: jax.Array,
    lr: float,
    variant: Variant,
) -> tuple[_State, jax.Array]:
    """One update of Adam, and its loss; the stored statistics move with the batch."""
    values, memory = state
    clean, noisy, valid = block
    noisy = noisy + deviation * jax.random.normal(key, noisy.shape, noisy.dtype)

    def loss_of(values: Values) -> tuple[jax.Array, Values]:
        out, seen = apply_and_learn(values, noisy[..., None], valid, variant=variant)
        square = jnp.where(valid, (out[..., 0] - clean) ** 2, 0.0)
        return jnp.log10(square.sum() / valid.sum(dtype=jnp.float32)), seen

    (loss, seen), gradient = jax.value_and_grad(loss_of, has_aux=True)(values)
    change, memory = optax.adam(lr).update(gradient, memory)
    trained = optax.apply_updates(values, change)
    # The statistics have no gradient: they are what the batches were.
    updated = lambda path, new, old: old if path[-1].key in RUNNING else new  # noqa: E731
    return (jax.tree.map_with_path(updated, trained, seen), memory), loss
