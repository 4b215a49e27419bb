"""Prepared pairs to training batches, by grain.

Batch k is a function of (seed, k) alone, so a resumed run takes up where it stopped by asking for batch k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np

from jaxsim.devices import check_batch
from jaxsim.frame import Pair


def stack(pairs: Sequence[Pair]) -> Pair:
    """Puts unbatched pairs along a new leading dimension."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *pairs)


def mirrored(pair: Pair) -> Pair:
    """The pair seen in a mirror: every raster's columns reversed."""
    return jax.tree.map(lambda raster: np.ascontiguousarray(raster[:, ::-1]), pair)


def magnified(pair: Pair, factor: float, position: tuple[float, float], *, size: tuple[int, int]) -> Pair:
    """The pair scaled to `factor` times `size` rows and columns, of which `size` are cut out.

    `position` says where, from 0 (top, left) to 1. A cell takes the value of the one that its centre falls into.
    """

    def take(raster: np.ndarray) -> np.ndarray:
        for axis, (n, share) in enumerate(zip(size, position, strict=True)):
            large = max(round(factor * n), n)
            start = min(int(share * (large - n + 1)), large - n)
            # Centres of the cells that are cut out, in cells of the original.
            cells = (start + np.arange(n) + 0.5) * raster.shape[axis] / large
            raster = raster.take(cells.astype(int), axis=axis)
        return raster

    return jax.tree.map(take, pair)


def crop(pair: Pair, size: tuple[int, int], position: tuple[float, float]) -> Pair:
    """So many rows and columns of the pair; `position` says where, from 0 (top, left) to 1."""
    spare = np.subtract(pair.target.shape, size)
    up, left = np.minimum((np.array(position) * (spare + 1)).astype(int), spare)
    return jax.tree.map(lambda raster: raster[up : up + size[0], left : left + size[1]], pair)


def recoloured(pair: Pair, amount: float, rng: np.random.Generator) -> Pair:
    """The pair as a camera of another exposure, contrast and colour balance sees it; each changes by about `amount`."""
    contrast, gain = np.exp(rng.normal(0, (amount, amount)))
    balance = np.exp(rng.normal(0, 0.3 * amount, 3))
    rgb = pair.painted.rgb**contrast * gain * balance
    grey = rgb.mean(-1, keepdims=True)
    rgb = np.clip(grey + (1 + rng.uniform(-1, 1) * amount) * (rgb - grey), 0, 1)
    return replace(pair, painted=replace(pair.painted, rgb=rgb.astype(np.float32)))


class Changing:
    """Batches of one loader before number `at`, and of another from there on."""

    def __init__(self, first: Any, then: Any, *, at: int):
        self.at, self._both = at, (first, then)

    def __getitem__(self, k: int) -> Pair:
        return self._both[k >= self.at][k]


def batches(
    pairs: Sequence[Pair],
    *,
    size: int,
    seed: int,
    flip: bool = False,
    jitter: float = 0.0,
    scale_limit: float = 0.0,
    raster: tuple[int, int] | None = None,
    cut: tuple[int, int] | None = None,
    part: int = 0,
    parts: int = 1,
) -> Any:
    """An endless, shuffled, random-access data set of batched pairs (`grain.MapDataset`).

    `raster` scales each pair to these rows and columns, where windows differ. `scale_limit` magnifies each by a
    factor between 1 and 1 plus it and cuts `raster` out anywhere (Imaginaire's `random_scale_limit` and crop); `flip`
    mirrors each with probability 1/2; `jitter` recolours each; `cut`, so many rows and columns, are cut out of each,
    anywhere. Of several processes each takes one of `parts` equal parts of every batch: part after part they are the
    batch that one process would take whole.

    Raises ValueError where there are fewer pairs than a batch, where it cannot be divided, or where `scale_limit`
    lacks `raster`.
    """
    import grain

    check_batch(len(pairs), size, parts, what="frames")
    if scale_limit and raster is None:
        raise ValueError(f"batches: scale_limit is {scale_limit}; raster must say the size to cut out")

    def draw(pair: Pair, rng: np.random.Generator) -> Pair:
        assert raster
        return magnified(pair, 1 + scale_limit * rng.random(), (rng.random(), rng.random()), size=raster)

    def draw_part(pair: Pair, rng: np.random.Generator) -> Pair:
        assert cut
        left, up = rng.random(), rng.random()
        return crop(pair, cut, (up, left))

    dataset = grain.MapDataset.source(pairs).seed(seed).shuffle().repeat()
    if raster:
        dataset = dataset.random_map(draw)
    if cut:
        dataset = dataset.random_map(draw_part)
    if flip:
        dataset = dataset.random_map(lambda pair, rng: mirrored(pair) if rng.random() < 0.5 else pair)
    if jitter:
        dataset = dataset.random_map(lambda pair, rng: recoloured(pair, jitter, rng))
    return dataset.batch(size // parts, drop_remainder=True, batch_fn=stack)[part::parts]
