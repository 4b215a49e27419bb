"""One 120k-point KITTI sweep onto its 64 x 2048 polar grid, index computation included.

`python benchmarks/speed/points_to_polar.py [SCAN.bin]`, from the repository's root; needs the extra `bench`. All
peers deliver the same: range, intensity, mask and index of the nearest point of every cell, the first of
equals. With JAX_PLATFORMS=cuda both jaxsim and PyTorch's CUDA build run on the GPU, and numba stays away.
"""

import math
import os
import sys
from pathlib import Path

# A peer's idle threads must not spin while another is being timed; and not all peers have an accelerator.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("KMP_BLOCKTIME", "0")
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
import numba
import numpy as np
import torch
from timing import interleave

from jaxsim.frame import Cloud
from jaxsim.geometry import full_grid, points_to_polar, preset, recover_rows

DATA = Path(os.environ.get("JAXSIM_SAMPLE_DATA", Path(__file__).parents[2] / "shared" / "data"))
SCAN = DATA / "kitti_object/training/velodyne/000001.bin"
ROWS, COLUMNS = 64, 2048
LAST = np.iinfo(np.int32).max
DEVICE = "cuda" if jax.default_backend() == "gpu" else "cpu"


def torch_polar(xyz, intensity, row, origin):
    x, y, z = xyz.unbind(-1)
    z = z - origin[row]
    r = torch.sqrt(x * x + y * y + z * z)
    column = torch.floor((math.pi - torch.atan2(y, x)) * (COLUMNS / (2 * math.pi))).long() % COLUMNS
    cell = row * COLUMNS + column
    nearest = torch.full((ROWS * COLUMNS,), torch.inf, device=DEVICE).scatter_reduce(0, cell, r, "amin")
    index = torch.where(r == nearest[cell], torch.arange(len(r), dtype=torch.int32, device=DEVICE), LAST)
    winner = torch.full((ROWS * COLUMNS,), LAST, dtype=torch.int32, device=DEVICE).scatter_reduce(
        0, cell, index, "amin"
    )
    valid = winner != LAST
    source = torch.where(valid, winner, 0)
    return torch.where(valid, r[source], 0), torch.where(valid, intensity[source], 0), valid, source


@numba.njit(parallel=True, fastmath={"contract", "arcp", "nsz"})
def numba_polar(xyz, intensity, row, origin):
    n = len(xyz)
    r, cell = np.empty(n, np.float32), np.empty(n, np.int32)
    scale = np.float32(COLUMNS / (2 * np.pi))
    for i in numba.prange(n):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2] - origin[row[i]]
        r[i] = math.sqrt(x * x + y * y + z * z)
        column = int((np.float32(np.pi) - math.atan2(y, x)) * scale)
        cell[i] = row[i] * COLUMNS + (column if column < COLUMNS else 0)
    size = ROWS * COLUMNS
    nearest, values = np.zeros(size, np.float32), np.zeros(size, np.float32)
    valid, winner = np.zeros(size, np.bool_), np.zeros(size, np.int32)
    for i in range(n):
        k = cell[i]
        if not valid[k] or r[i] < nearest[k]:
            valid[k], nearest[k], values[k], winner[k] = True, r[i], intensity[i], i
    return nearest, values, valid, winner


def main() -> None:
    scan = Path(sys.argv[1]) if len(sys.argv) > 1 else SCAN
    points = np.fromfile(scan, np.float32).reshape(-1, 4)
    xyz, intensity = points[:, :3].copy(), points[:, 3].copy()
    row, grid = recover_rows(xyz), full_grid(preset("hdl64e"), COLUMNS)
    cloud = jax.device_put(Cloud(xyz, intensity, np.ones(len(xyz), bool), row))
    on_device = jax.device_put(grid)
    arrays = (xyz, intensity, row.astype(np.int64), np.asarray(grid.origin_m))
    tensors = [torch.from_numpy(a).to(DEVICE) for a in arrays]

    def ours():
        return jax.block_until_ready(points_to_polar(cloud, on_device))

    def theirs_torch():
        result = torch_polar(*tensors)
        if DEVICE == "cuda":
            torch.cuda.synchronize()
        return result

    def theirs_numba():
        return numba_polar(xyz, intensity, row, grid.origin_m)

    image, winner = ours()
    peers = {"torch": theirs_torch} | ({"numba": theirs_numba} if DEVICE == "cpu" else {})
    for name, peer in peers.items():
        same = (np.asarray(peer()[3] if DEVICE == "cpu" else peer()[3].cpu()) == np.asarray(winner).ravel()).mean()
        print(f"{name} picks the same point in {100 * same:.4f} % of the cells")
        if same < 0.999:
            raise SystemExit(f"{name} does not do the same work")
    print(f"{len(xyz)} points, {int(image.valid.sum())} cells filled")
    interleave(
        "points to polar, 64 x 2048",
        {"jaxsim": ours, **peers},
        rounds=41,
    )


if __name__ == "__main__":
    main()
