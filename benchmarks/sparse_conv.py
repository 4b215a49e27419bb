"""A sparse convolution's forward pass against spconv's CPU wheel; the backward pass and the tables alone.

    python benchmarks/sparse_conv.py [VELODYNE.bin]

Sites are the voxels of a KITTI scan ahead of the car (or, without a file, of a made-up street of the same density),
0.05 x 0.05 x 0.1 m, at most 16000. spconv (`pip install spconv`, and torch) has no backward pass on a CPU, and its
forward pass has a data race there with more than one thread (218 of 30000 rows wrong): it runs on one.
"""

from __future__ import annotations

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from timing import interleave

from jaxsim.config import VoxelConfig
from jaxsim.detect.sparse import Sites, cells, sparse_conv, strided_sites, strided_tables, submanifold_tables
from jaxsim.detect.voxelize import voxelize

CONFIG, CAP = VoxelConfig(), 16000
FORM = ((3, 3, 3), (2, 2, 2), (1, 1, 1))


def street(rng: np.random.Generator) -> np.ndarray:
    """A road with walls and boxes, 19000 points ahead of the car, denser near it."""
    reach = 3 + 60 * rng.random(19000) ** 2
    side = rng.uniform(-0.7, 0.7, 19000)
    x, y = reach * np.cos(side), reach * np.sin(side)
    wall = np.abs(y) > 8
    z = np.where(wall, rng.uniform(-1.7, 0.9, 19000), -1.7 + 0.02 * rng.standard_normal(19000))
    return np.column_stack([x, np.clip(y, -8, 8), z, rng.random(19000)]).astype(np.float32)


def ahead(path: Path) -> np.ndarray:
    """Points of a scan that a camera of 81 degrees sees."""
    points = np.fromfile(path, "<f4").reshape(-1, 4)
    return points[(points[:, 0] > 0) & (np.abs(points[:, 1]) < 0.85 * points[:, 0])]


def in_spconv(sites: Sites, features: np.ndarray, kernel: np.ndarray):
    """spconv's submanifold convolution of the same numbers, or None where it is not installed."""
    try:
        import spconv.pytorch as spconv
        import torch
    except ModuleNotFoundError as error:
        print(f"{error.name} is not installed: no comparison with spconv")
        return None
    torch.set_num_threads(1)
    used = np.asarray(sites.valid)
    places = np.column_stack([np.zeros(used.sum()), np.asarray(sites.zyx)[used]]).astype(np.int32)
    layer = spconv.SubMConv3d(features.shape[1], kernel.shape[-1], 3, bias=False, indice_key="same")
    layer.weight.data = torch.from_numpy(np.moveaxis(kernel, -1, 0).copy())
    rows = torch.from_numpy(features[used])
    first = spconv.SparseConvTensor(rows, torch.from_numpy(places), list(sites.shape), 1)
    with torch.no_grad():
        known = layer(first).indice_dict  # neighbours once, as we have our tables

    def run() -> np.ndarray:
        again = spconv.SparseConvTensor(rows, first.indices, list(sites.shape), 1, indice_dict=known)
        with torch.no_grad():
            return layer(again).features.numpy()

    return run


def main() -> None:
    rng = np.random.default_rng(0)
    points = ahead(Path(sys.argv[1])) if len(sys.argv) > 1 else street(rng)
    valid = np.ones(len(points), bool)
    make = jax.jit(lambda p, v: voxelize(p, v, CONFIG, max_voxels=CAP))
    voxels = make(points, valid)
    sites = voxels.sites
    same = jax.jit(lambda s: submanifold_tables(s, (3, 3, 3)))
    tables = same(sites)
    filled = float((tables.forward < CAP).mean())
    print(f"{int(sites.valid.sum())} voxels of {cells(sites.shape):,} cells, {filled:.1%} of the table's places filled")

    @jax.jit
    def down(s: Sites):
        out, dropped = strided_sites(s, *FORM, capacity=5 * CAP // 2)
        return strided_tables(s, out, *FORM), dropped

    interleave(
        "tables, in ms",
        {
            "submanifold": lambda: jax.block_until_ready(same(sites).forward),
            "strided": lambda: jax.block_until_ready(down(sites)[0].backward),
            "voxelize": lambda: jax.block_until_ready(make(points, valid).features),
        },
    )
    convolve = jax.jit(sparse_conv)
    for channels in (16, 32, 64):
        features = rng.standard_normal((CAP, channels)).astype(np.float32)
        kernel = rng.standard_normal((3, 3, 3, channels, channels)).astype(np.float32)
        x, w = jnp.asarray(features), jnp.asarray(kernel)
        both = jax.jit(jax.value_and_grad(lambda x, w: (sparse_conv(x, w, tables) ** 2).sum(), (0, 1)))
        peers = {
            "jaxsim forward": lambda x=x, w=w: jax.block_until_ready(convolve(x, w, tables)),
            "jaxsim both": lambda x=x, w=w, both=both: jax.block_until_ready(both(x, w)),
        }
        theirs = in_spconv(sites, features, kernel)
        if theirs is not None:
            off = np.abs(theirs() - np.asarray(convolve(x, w, tables))[np.asarray(sites.valid)]).max()
            print(f"largest difference to spconv: {off:.2g}")
            peers["spconv forward"] = theirs
        interleave(f"submanifold 3 x 3 x 3, {channels} to {channels} channels", peers)


if __name__ == "__main__":
    main()
