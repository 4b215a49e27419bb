"""Prepared pairs to training batches, by grain.

Batch k is a function of (seed, k) alone, so a resumed run takes up where it stopped by asking for batch k.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from jaxsim.frame import Pair


def stack(pairs: Sequence[Pair]) -> Pair:
    """Puts unbatched pairs along a new leading dimension."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *pairs)


def mirrored(pair: Pair) -> Pair:
    """The pair seen in a mirror: every raster's columns reversed."""
    return jax.tree.map(lambda raster: np.ascontiguousarray(raster[:, ::-1]), pair)


def batches(pairs: Sequence[Pair], *, size: int, seed: int, flip: bool = False) -> Any:
    """An endless, shuffled, random-access data set of batched pairs (`grain.MapDataset`).

    `flip` mirrors each pair with probability 1/2. Raises ValueError where there are fewer pairs than a batch.
    """
    import grain

    if len(pairs) < size:
        raise ValueError(f"batches: {len(pairs)} training frames cannot fill a batch of {size}; lower --optim.batch")
    dataset = grain.MapDataset.source(pairs).seed(seed).shuffle().repeat()
    if flip:
        dataset = dataset.random_map(lambda pair, rng: mirrored(pair) if rng.random() < 0.5 else pair)
    return dataset.batch(size, drop_remainder=True, batch_fn=stack)
