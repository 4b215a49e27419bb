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
"""Frames of a single drive are cut into so many."""
GUARD_COLUMNS = 4
"""Left out on each side of a sector: neighbouring rays share a surface."""


@dataclass(frozen=True)
class Blocks:
    """Columns of frames, with the name of the unit that each block belongs to."""

    frame: Int[np.ndarray, " b"]
    column: Int[np.ndarray, "b c"]
    unit: tuple[str, ...]


def blocks(scenes: Sequence[str], rows: int, columns: int, *, rays: int = RAYS, seed: int = 0) -> Blocks:
    """Columns spread evenly over each frame, the first at random; of frames of one scene, sectors of the scan.

    Where all frames are of one scene, a sector of all of them is one unit: what a car or a wall does to one frame it
    does to the next. Raises ValueError where sectors would be too narrow.
    """
    rng = np.random.default_rng(seed)
    frames = len(scenes)
    if len(set(scenes)) == 1:
        width = columns // SECTORS
        inner = width - 2 * GUARD_COLUMNS
        if inner < FEWEST_COLUMNS:
            raise ValueError(
                f"discover: frames of one drive, of {columns} columns, are too narrow to be cut into {SECTORS} "
                "independent sectors; give frames of several drives, or "
                f"{SECTORS * (FEWEST_COLUMNS + 2 * GUARD_COLUMNS)} columns or more"
            )
        count = min(inner, max(-(-FEWEST_COLUMNS // frames), rays // (rows * SECTORS * frames)))
        within = GUARD_COLUMNS + _spread(rng, frames, inner, count)
        column = np.arange(SECTORS)[None, :, None] * width + within[:, None, :]
        sectors = [f"sector {k:02d}" for k in range(SECTORS)]
        return Blocks(np.repeat(np.arange(frames), SECTORS), column.reshape(-1, count), (*sectors,) * frames)
    count = min(columns, max(FEWEST_COLUMNS, rays // (rows * frames)))
    return Blocks(np.arange(frames), _spread(rng, frames, columns, count), tuple(scenes))


def _spread(rng: np.random.Generator, frames: int, columns: int, count: int) -> Int[np.ndarray, "frames count"]:
    """Even steps through so many columns, each frame from another start."""
    step = columns / count
    first = rng.uniform(0, step, (frames, 1))
    return np.minimum(np.floor(first + step * np.arange(count)).astype(int), columns - 1)
