"""`jaxsim discover` on folders of any number of frames: seconds, processor seconds, peak memory, and how they grow.

    python -m benchmarks.speed.many_frames WORK [--frames 2000 4000 10000] [--rows 64] [--columns 1024] [--every-frame]

WORK gets 16 frames of `benchmarks/blind/hidden` (range_falloff, severity 4), and so many links to them under names of
their own, 50 to a scene: each is read and unpacked as a file of its own, so that time and memory are those of as many
frames; the answer's certainty is not, and the disk is spared. Each number of frames is a process of its own. WORK's
links are removed when they were read.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.blind.hidden import make_case

SCENE = 50


class Used(NamedTuple):
    """What one answer took."""

    frames: int
    wall_s: float
    processor_s: float
    peak_gib: float


def spread(case: Path, out: Path, frames: int) -> None:
    """Folders of `frames` links to a case's frames."""
    for side in ("measured", "simulated"):
        (out / side).mkdir(parents=True, exist_ok=True)
        grid = json.loads((case / side / "grid.json").read_text())
        names = sorted(path.stem for path in (case / side).glob("*.npz"))
        about = {}
        for k in range(frames):
            path = out / side / f"{k:06d}.npz"
            if not path.exists():
                os.link(case / side / f"{names[k % len(names)]}.npz", path)
            fact = {key: value for key, value in grid["frames"][names[k % len(names)]].items() if key != "time"}
            about[path.stem] = fact | {"scene": f"s{k // SCENE:04d}"}
        (out / side / "grid.json").write_text(json.dumps(grid | {"frames": about}))


def answer(folder: Path, frames: int, flags: Sequence[str]) -> Used:
    """Runs the command on a folder's two sides. Raises ChildProcessError where it fails."""
    sides = ["--measured", str(folder / "measured"), "--simulated", str(folder / "simulated")]
    begun = time.monotonic()
    child = subprocess.Popen(
        [sys.executable, "-m", "jaxsim", "discover", *sides, "--out", str(folder / "answer"), *flags]
    )
    # The peak of this child alone: RUSAGE_CHILDREN keeps the largest of all.
    _, status, used = os.wait4(child.pid, 0)
    if status:
        raise ChildProcessError(f"discover of {frames} frames ended with status {status}")
    return Used(frames, time.monotonic() - begun, used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20)


def exponent(rows: Sequence[Used]) -> float:
    """The power of the number of frames with which processor time grows."""
    return float(np.polyfit(np.log([row.frames for row in rows]), np.log([row.processor_s for row in rows]), 1)[0])


def main(work: Path, frames: Sequence[int], *, rows: int, columns: int, flags: Sequence[str]) -> None:
    case = work / f"case_{rows}x{columns}"
    if not case.is_dir():
        make_case(case, effect="range_falloff", severity=4, seed=7, rows=rows, columns=columns)
    done = []
    for count in frames:
        folder = work / str(count)
        spread(case, folder, count)
        done.append(answer(folder, count, flags))
        print(
            "{0.frames} frames: {0.wall_s:.0f} s, {0.processor_s:.0f} s of processor time, "
            "peak {0.peak_gib:.2f} GiB".format(done[-1]),
            flush=True,
        )
        for side in ("measured", "simulated"):
            shutil.rmtree(folder / side)
    if len(done) > 1:
        print(f"processor time grows with frames to the power of {exponent(done):.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    parser.add_argument("--frames", type=int, nargs="+", default=[10_000])
    parser.add_argument("--rows", type=int, default=64)
    parser.add_argument("--columns", type=int, default=1024)
    parser.add_argument("--every-frame", action="store_true")
    given = parser.parse_args()
    main(given.work, given.frames, rows=given.rows, columns=given.columns, flags=["--every-frame"] * given.every_frame)
