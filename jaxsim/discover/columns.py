"""Which columns of which frames are looked at, and the units that they belong to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

RAYS = 20_000
"""Rays that a fit looks at, if the frames have so many."""
FEWEST_COLUMNS = 8
"""Of each frame that are looked at in any case."""
SECTORS = 12
"""A single scan is cut into so many."""
GUARD_COLUMNS = 4
"""Left out on each side of a sector: neighbouring rays share a surface."""


@dataclass(frozen=True)
class Blocks:
    """Columns of frames, with the name of the unit that each block belongs to."""

    frame: Int[np.ndarray, " b"]
    column: Int[np.ndarray, "b c"]
    unit: tuple[str, ...]


def blocks(scenes: Sequence[str], rows: int, columns: int, *, rays: int = RAYS, seed: int = 0) -> Blocks:
    """Columns spread evenly over each frame, the first at random; of frames of one scene, sectors of the scan."""
    rng = np.random.default_rng(seed)
    if len(set(scenes)) == 1 and len(scenes) == 1:
        width = columns // SECTORS
        inner = np.arange(GUARD_COLUMNS, width - GUARD_COLUMNS)
        if len(inner) < FEWEST_COLUMNS:
            raise ValueError(
                f"discover: one scan of {columns} columns is too narrow to be cut into {SECTORS} independent sectors; "
                "give more frames, of several drives"
            )
        column = np.arange(SECTORS)[:, None] * width + inner
        count = max(FEWEST_COLUMNS, min(len(inner), rays // (rows * SECTORS)))
        chosen = np.linspace(0, len(inner) - 1, count).round().astype(int)
        return Blocks(np.zeros(SECTORS, int), column[:, chosen], tuple(f"sector {k:02d}" for k in range(SECTORS)))
    count = min(columns, max(FEWEST_COLUMNS, rays // (rows * len(scenes))))
    step = columns / count
    first = rng.uniform(0, step, (len(scenes), 1))
    column = np.floor(first + step * np.arange(count)).astype(int)
    return Blocks(np.arange(len(scenes)), np.minimum(column, columns - 1), tuple(scenes))
