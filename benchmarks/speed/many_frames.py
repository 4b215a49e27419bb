"""`jaxsim discover` on folders of any number of frames: seconds, processor seconds and peak memory.

    python -m benchmarks.speed.many_frames WORK [--frames 10000]

WORK gets 16 frames of 64 x 1024 of `benchmarks/blind/hidden` (range_falloff, severity 4), and so many links to them
under names of their own, 50 to a scene: time and memory are those of as many frames, the answer's certainty is not.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.blind.hidden import make_case

SCENE = 50


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


def main(work: Path, frames: int) -> None:
    if not (work / "case").is_dir():
        make_case(work / "case", effect="range_falloff", severity=4, seed=7, rows=64, columns=1024)
    out = work / str(frames)
    spread(work / "case", out, frames)
    begun = time.monotonic()
    sides = ["--measured", str(out / "measured"), "--simulated", str(out / "simulated")]
    subprocess.run([sys.executable, "-m", "jaxsim", "discover", *sides, "--out", str(out / "answer")], check=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"{frames} frames: {time.monotonic() - begun:.0f} s, {used.ru_utime + used.ru_stime:.0f} s of processor time, "
        f"peak {used.ru_maxrss / 2**20:.2f} GiB"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    parser.add_argument("--frames", type=int, default=10_000)
    main(**vars(parser.parse_args()))
