"""Two thousand polar frames take no more memory than two hundred: the writer and the readers hold a few at a time."""

import resource
import subprocess
import sys

import pytest

from tests.programs import environment

WRITES_AND_READS = """
import resource, sys
from pathlib import Path
import numpy as np
from jaxsim.data.polar_frames import open_polar_frames, write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage

folder, count, rows, columns = Path(sys.argv[1]), int(sys.argv[2]), 32, 128
grid = PolarGrid(np.linspace(1, -1, columns, dtype="f4"), np.linspace(0, -0.4, rows, dtype="f4"), np.zeros(rows, "f4"))
rng, valid = np.random.default_rng(0), np.ones((rows, columns), bool)
write_grid(folder, grid, frames={f"{k:06d}": {"scene": f"{k // 100}", "time": k / 10} for k in range(count)})
for k in range(count):
    range_m, intensity = rng.uniform(3, 60, (rows, columns)), rng.random((rows, columns))
    write_frame(folder, f"{k:06d}", PolarImage(range_m.astype("f4"), intensity.astype("f4"), valid))
frames = open_polar_frames(folder)
total = sum(float(frames.read(name)[0].range_m.mean()) for name in frames.names)
print(len(frames.names), total / count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
"""


def peak_mb(folder, count: int) -> int:
    """Megabytes that a program takes at most which writes and reads so many frames."""
    command = [sys.executable, "-c", WRITES_AND_READS, str(folder), str(count)]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment(folder), check=True)
    read, mean_m, peak = ended.stdout.split()
    assert int(read) == count
    assert float(mean_m) == pytest.approx(31.5, abs=0.1)
    return int(peak)


@pytest.mark.skipif(not hasattr(resource, "RUSAGE_SELF"), reason="the system does not tell the memory of a program")
def test_memory_does_not_grow_with_the_number_of_frames(tmp_path):
    for name in ("few", "many"):
        (tmp_path / name).mkdir()
    few, many = peak_mb(tmp_path / "few", 200), peak_mb(tmp_path / "many", 2000)
    # All 2000 in memory would be 65 MB more; their names and grid.json are 2 MB.
    assert many < few + 25
