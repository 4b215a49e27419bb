"""`python -m tests.data.many_frames FOLDER COUNT [ROWS COLUMNS SEED]`: writes frames as `simulate` does, reads all.

Prints how many were read, their mean range in metres, and the most memory that it took, in MB.
"""

import sys
from pathlib import Path

import numpy as np

from jaxsim.data.polar_frames import open_polar_frames, write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage
from tests.programs import peak_mb


def main(folder: Path, count: int, rows: int = 32, columns: int = 128, seed: int = 0) -> None:
    grid = PolarGrid(
        np.linspace(1, -1, columns, dtype="f4"), np.linspace(0, -0.4, rows, dtype="f4"), np.zeros(rows, "f4")
    )
    rng, valid = np.random.default_rng(seed), np.ones((rows, columns), bool)
    folder.mkdir(parents=True, exist_ok=True)
    write_grid(folder, grid, frames={f"{k:06d}": {"scene": f"{k // 100}", "time": k / 10} for k in range(count)})
    for k in range(count):
        range_m, intensity = rng.uniform(3, 60, (rows, columns)), rng.random((rows, columns))
        write_frame(folder, f"{k:06d}", PolarImage(range_m.astype("f4"), intensity.astype("f4"), valid))
    frames = open_polar_frames(folder)
    total = sum(float(frames.read(name)[0].range_m.mean()) for name in frames.names)
    print(len(frames.names), total / count, peak_mb())


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
