"""A thousand polar frames take no more memory than a hundred: the writer and the readers hold a few at a time."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.programs import environment


def peak_mb(folder, count: int) -> int:
    """Megabytes that a program takes at most which writes and reads so many frames."""
    command = [sys.executable, "-m", "tests.data.many_frames", str(folder), str(count), "64"]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment(), check=True)
    read, mean_m, peak = ended.stdout.split()
    assert int(read) == count
    assert float(mean_m) == pytest.approx(31.5, abs=0.1)
    return int(peak)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system does not tell the memory of a program")
def test_memory_does_not_grow_with_the_number_of_frames(tmp_path):
    for name in ("few", "many"):
        (tmp_path / name).mkdir()
    few, many = peak_mb(tmp_path / "few", 100), peak_mb(tmp_path / "many", 1000)
    # All 1000 in memory would be 66 MB more; their names and grid.json are 1 MB.
    assert many < few + 25
