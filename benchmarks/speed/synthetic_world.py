"""Frames a second of the embedded world: a 64 x 1024 sweep, a 1242 x 375 picture with depth and labels, boxes.

    python benchmarks/speed/synthetic_world.py

There is no peer: nothing else here draws the same streets. The parts of a frame are timed in turn on the same
numbers, then 40 frames of 10 streets are made one after the other, as for a data set.
"""

import itertools
import time

from timing import interleave

from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.data.synthetic.layout import lay_out

FRAMES = 40


def main() -> None:
    start = time.perf_counter()
    world = SyntheticWorld(seed=0)
    world[0]
    print(f"first frame, with compilation: {time.perf_counter() - start:.1f} s")
    numbers = {name: itertools.count() for name in ("frame", "sweep", "layout")}

    def sweep() -> None:
        i = next(numbers["sweep"]) % FRAMES
        world.measure(i, world.truth(i))

    interleave(
        "one frame of the embedded world and its parts",
        {
            "whole frame": lambda: world[next(numbers["frame"]) % FRAMES],
            "sweep alone": sweep,
            "layout of a street": lambda: lay_out(0, next(numbers["layout"]) % 10),
        },
        rounds=20,
    )
    start = time.perf_counter()
    for i in range(FRAMES):
        world[i]
    seconds = time.perf_counter() - start
    print(f"\n{FRAMES} frames: {FRAMES / seconds:.2f} frames/s ({seconds / FRAMES * 1e3:.0f} ms a frame)")


if __name__ == "__main__":
    main()
