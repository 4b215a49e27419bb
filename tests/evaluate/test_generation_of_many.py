"""Two thousand frames are held against others in the memory of two hundred: a batch of them is there at a time."""

import gc
import tracemalloc
import weakref
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from jaxsim.data.polar_frames import PolarFrames
from jaxsim.evaluate import generation
from jaxsim.evaluate.generation import BATCH, Folder, generation_scores
from jaxsim.frame import PolarGrid, PolarImage

ROWS, COLUMNS = 8, 32
GRID = PolarGrid(
    np.linspace(0.6, -0.6, COLUMNS, dtype="f4"), np.linspace(0, -0.4, ROWS, dtype="f4"), np.zeros(ROWS, "f4")
)


@dataclass(frozen=True)
class Counted(PolarFrames):
    """Frames that are made when they are read, and of which is known how many are held."""

    held: set = field(default_factory=set)
    most: list = field(default_factory=lambda: [0])

    def read(self, name):
        rng, key = np.random.default_rng(int(name)), object()
        range_m = rng.uniform(5, 60, (ROWS, COLUMNS)).astype("f4")
        self.held.add(key)
        weakref.finalize(range_m, self.held.discard, key)
        self.most[0] = max(self.most[0], len(self.held))
        return PolarImage(range_m, rng.random((ROWS, COLUMNS), "f4"), np.ones((ROWS, COLUMNS), bool)), {}


def folder(count, first=0):
    names = tuple(f"{first + k:06d}" for k in range(count))
    return Folder(Path(f"frames{count}"), names, Counted(Path("nowhere"), GRID, {}, names))


@pytest.mark.long
def test_memory_does_not_grow_with_the_number_of_frames(monkeypatch):
    monkeypatch.setattr(generation, "POINTS", ROWS * COLUMNS)
    monkeypatch.setattr(generation, "COUNTS", {"r2dm": generation.COUNTS["r2dm"]})  # the other's images are large
    other = folder(24)
    generation_scores(folder(24), other, compared=8)  # compiles
    peaks = []
    for count in (200, 2000):
        many = folder(count)
        gc.collect()
        tracemalloc.start()
        scores = generation_scores(many, other, compared=8)
        peaks.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
        assert scores["chamfer_distance_m"].count == 24
        assert scores["intensity"].count == 24 * ROWS * COLUMNS
        assert many.frames.most[0] <= 2 * BATCH
    # Their range and intensity alone would be 3.7 MB more, their points 7.4.
    assert peaks[1] < peaks[0] + 1.5, peaks
