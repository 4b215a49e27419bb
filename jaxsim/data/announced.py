"""The grid.json of a folder that frames are added to: what it says of them is written often, and in all as seldom as
the growing file asks for."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxsim.data.polar_frames import read_grid, write_grid
from jaxsim.frame import PolarGrid
from jaxsim.geometry import same_grid

SHARE = 0.05
"""Of the time that writing may take: grid.json of 100 000 frames has 10 MB, and a batch more would write all of it."""


class Announced:
    """What a folder's grid.json says of its frames, by name.

    A frame that it does not name yet is not done, though its file may be there: a killed command makes those of the
    last seconds anew. As a context it writes down all of them at its end, those of `order` last and in this order.
    `by` is who writes them. Raises ValueError where the folder is of another grid.
    """

    def __init__(self, folder: Path, grid: PolarGrid, *, order: Sequence[str] = (), by: str = "simulate"):
        self.folder = folder
        self.grid = grid
        self.order = order
        self.frames: dict[str, dict[str, Any]] = {}
        self.pending = False
        self._next_s = 0.0
        if (folder / "grid.json").is_file():
            old, self.frames = read_grid(folder)
            if not same_grid(old, grid):
                raise ValueError(
                    f"{by}: {folder} holds frames of another grid ("
                    f"{len(old.elevation_rad)} x {len(old.azimuth_rad)} cells; these have {len(grid.elevation_rad)} x "
                    f"{len(grid.azimuth_rad)}); give another --out"
                )

    def __enter__(self) -> Announced:
        return self

    def __exit__(self, *error: object) -> None:
        # However they came: the file of a killed or a spread command is that of any other.
        asked = {*self.order}
        others = {name: about for name, about in self.frames.items() if name not in asked}
        ordered = others | {name: self.frames[name] for name in self.order if name in self.frames}
        self.pending |= [*ordered] != [*self.frames]
        self.frames = ordered
        self.write()

    def add(self, about: Mapping[str, dict[str, Any]]) -> None:
        """Adds frames, by name; they are written down now, or within the time that SHARE gives."""
        self.frames |= about
        self.pending = True
        if time.monotonic() >= self._next_s:
            self.write()

    def write(self) -> None:
        """Writes down what is not yet."""
        if not self.pending:
            return
        begun = time.monotonic()
        write_grid(self.folder, self.grid, frames=self.frames)
        ended = time.monotonic()
        self.pending, self._next_s = False, ended + (ended - begun) / SHARE
