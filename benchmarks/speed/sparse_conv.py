"""A sparse convolution's forward pass, and a whole stage with its neighbours, against spconv's CPU wheel; the backward
pass and the tables alone; all in both of our forms, in C++ and XLA's.

    python benchmarks/speed/sparse_conv.py [VELODYNE.bin]

Sites are the voxels of a KITTI scan ahead of the car (or, without a file, of a made-up street of the same density),
0.05 x 0.05 x 0.1 m, at most 16000. spconv (`pip install spconv`, and torch) has no backward pass on a CPU, and its
forward pass has a data race there with more than one thread (218 of 30000 rows wrong): it runs on one. The stage is
the backbone's second: a strided convolution and two submanifold ones with ReLU, neighbours found anew on both sides.

On a GPU there is XLA's form alone, and the peer of a convolution is PyTorch's on the same GPU with the same table: rows
gathered and multiplied, a cell of the kernel after another, by autograd backwards.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from timing import interleave

from jaxsim.config import VoxelConfig
from jaxsim.detect.sparse import (
    CUBE,
    ConvWindow,
    Sites,
    cells,
    sparse_conv,
    strided_sites,
    strided_tables,
    submanifold_tables,
)
from jaxsim.detect.voxelize import voxelize
from jaxsim.native import build

CONFIG, CAP = VoxelConfig(), 16000
HALVING = ConvWindow(CUBE, stride=(2, 2, 2), padding=(1, 1, 1))
STAGE = (16, 32)
"""Channels before and after the strided convolution."""


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


def forms(function: Callable, *arguments) -> dict[str, Callable]:
    """The function as compiled programs of both forms, by name; the arguments only show their shapes."""
    compiled = {}
    asked = os.environ.get(build.SETTING, "1")
    both = (("C++", asked), ("XLA", "0"))
    for name, setting in both if jax.default_backend() == "cpu" else both[1:]:
        os.environ[build.SETTING] = setting
        # A function of its own: programs of one function are traced once.
        compiled[name] = jax.jit(lambda *given: function(*given)).lower(*arguments).compile()
    os.environ[build.SETTING] = asked
    return compiled


def timed(programs: dict[str, Callable], *arguments, what: str = "") -> dict[str, Callable]:
    """Calls to time, by name."""
    return {
        f"{name}{what}": lambda program=program: jax.block_until_ready(program(*arguments))
        for name, program in programs.items()
    }


def stage(sites: Sites, features: jax.Array, kernels: list[jax.Array], capacity: int) -> tuple[Sites, jax.Array]:
    """A strided convolution and two submanifold ones, each with ReLU, and the tables that they need."""
    out, _ = strided_sites(sites, HALVING, capacity)
    x = jax.nn.relu(sparse_conv(features, kernels[0], strided_tables(sites, out, HALVING)))
    same = submanifold_tables(out)
    for kernel in kernels[1:]:
        x = jax.nn.relu(sparse_conv(x, kernel, same))
    return out, x


def stage_in_spconv(sites: Sites, features: np.ndarray, kernels: list[np.ndarray]):
    """The same stage of the same numbers in spconv: gives keys of its sites and features. None where not installed."""
    try:
        import spconv.pytorch as spconv
        import torch
    except ModuleNotFoundError:
        return None  # in_spconv said so
    torch.set_num_threads(1)
    (size, stride, padding), (low, high) = HALVING, STAGE
    layers = [
        spconv.SparseConv3d(low, high, size, stride=stride, padding=padding, bias=False),
        spconv.SubMConv3d(high, high, size, bias=False, indice_key="same"),
        spconv.SubMConv3d(high, high, size, bias=False, indice_key="same"),
    ]
    for layer, kernel in zip(layers, kernels, strict=True):
        layer.weight.data = torch.from_numpy(np.moveaxis(kernel, -1, 0).copy())
    used = np.asarray(sites.valid)
    places = np.column_stack([np.zeros(used.sum()), np.asarray(sites.zyx)[used]]).astype(np.int32)
    rows, indices = torch.from_numpy(features[used]), torch.from_numpy(places)

    def run() -> tuple[np.ndarray, np.ndarray]:
        x = spconv.SparseConvTensor(rows, indices, list(sites.shape), 1)
        with torch.no_grad():
            for layer in layers:
                x = layer(x)
                x = x.replace_feature(torch.relu(x.features))
        return x.indices.numpy()[:, 1:], x.features.numpy()

    return run


def on_gpu(features: np.ndarray, kernel: np.ndarray, table: np.ndarray) -> dict[str, Callable]:
    """PyTorch's gathered rows and products of the same numbers, forward and with the gradient, on the GPU."""
    import torch

    torch.backends.cuda.matmul.allow_tf32 = True  # as XLA does
    x = torch.from_numpy(np.concatenate([features, np.zeros_like(features[:1])])).cuda().requires_grad_()
    w = torch.from_numpy(kernel.reshape(-1, *kernel.shape[-2:])).cuda().requires_grad_()
    places = torch.from_numpy(table.T.astype(np.int64)).cuda()

    def product():
        total = torch.zeros(table.shape[0], kernel.shape[-1], device="cuda")
        for row, weights in zip(places, w, strict=True):
            total = total + x.index_select(0, row) @ weights
        return total

    def forward() -> np.ndarray:
        with torch.no_grad():
            found = product()
        torch.cuda.synchronize()
        return found.cpu().numpy()

    def both() -> None:
        torch.autograd.grad((product() ** 2).sum(), (x, w))
        torch.cuda.synchronize()

    return {"torch": forward, "torch and backward": both}


def compare_stages(sites: Sites, rng: np.random.Generator) -> None:
    """Times both, after checking that sites and features are the same."""
    low, high = STAGE
    capacity = round(CONFIG.growth[0] * CAP)
    features = rng.standard_normal((CAP, low)).astype(np.float32)
    widths = (low, high, high)
    kernels = [(rng.standard_normal((3, 3, 3, c, high)) / (27 * c) ** 0.5).astype(np.float32) for c in widths]
    x, w = jnp.asarray(features), [jnp.asarray(kernel) for kernel in kernels]
    ours = forms(lambda s, x, w: stage(s, x, w, capacity), sites, x, w)
    both = forms(jax.grad(lambda x, w, s: (stage(s, x, w, capacity)[1] ** 2).sum(), (0, 1)), x, w, sites)
    peers = timed(ours, sites, x, w)
    theirs = stage_in_spconv(sites, features, kernels) if jax.default_backend() == "cpu" else None
    if theirs is not None:
        places, values = theirs()
        out, found = ours["C++"](sites, x, w)
        used = np.asarray(out.valid)
        order = np.lexsort(places.T[::-1])
        if not np.array_equal(np.asarray(out.zyx)[used], places[order]):
            raise SystemExit(f"the stages have other sites: {used.sum()} and {len(places)}")
        print(
            f"stage: {used.sum()} sites; largest difference {np.abs(np.asarray(found)[used] - values[order]).max():.2g}"
        )
        peers["spconv"] = theirs
    peers |= timed(both, x, w, sites, what=" and backward")
    interleave(f"a stage with its tables: strided {low} to {high}, two submanifold, forward", peers)


def main() -> None:
    rng = np.random.default_rng(0)
    points = ahead(Path(sys.argv[1])) if len(sys.argv) > 1 else street(rng)
    valid = np.ones(len(points), bool)
    make = jax.jit(lambda p, v: voxelize(p, v, CONFIG, max_voxels=CAP))
    voxels = make(points, valid)
    sites = voxels.sites
    print(f"form: {build.form()}")
    same = forms(submanifold_tables, sites)
    tables = same["XLA"](sites)
    filled = float((tables.forward < CAP).mean())
    print(
        f"{int(sites.valid.sum())} voxels of {cells(sites.shape):,} cells, "
        f"{100 * filled:.1f} % of the table's places filled"
    )

    def down(s: Sites):
        out, dropped = strided_sites(s, HALVING, 5 * CAP // 2)
        return strided_tables(s, out, HALVING), dropped

    interleave(
        "tables",
        {
            **timed(same, sites, what=", submanifold"),
            **timed(forms(down, sites), sites, what=", strided"),
            "voxelize": lambda: jax.block_until_ready(make(points, valid).features),
        },
    )
    for channels in (16, 32, 64):
        features = rng.standard_normal((CAP, channels)).astype(np.float32)
        kernel = rng.standard_normal((3, 3, 3, channels, channels)).astype(np.float32)
        x, w = jnp.asarray(features), jnp.asarray(kernel)
        forward = forms(sparse_conv, x, w, tables)
        both = forms(jax.grad(lambda x, w, t: (sparse_conv(x, w, t) ** 2).sum(), (0, 1)), x, w, tables)
        peers = timed(forward, x, w, tables)
        found = np.asarray(next(iter(forward.values()))(x, w, tables))
        if jax.default_backend() == "gpu":
            gathered = on_gpu(features, kernel, np.asarray(tables.forward))
            print(f"largest difference to torch: {np.abs(gathered['torch']() - found).max():.2g}")
            peers |= gathered
        theirs = in_spconv(sites, features, kernel) if jax.default_backend() == "cpu" else None
        if theirs is not None:
            off = np.abs(theirs() - found[np.asarray(sites.valid)]).max()
            print(f"largest difference to spconv: {off:.2g}")
            peers["spconv"] = theirs
        peers |= timed(both, x, w, tables, what=" and backward")
        interleave(f"submanifold 3 x 3 x 3, {channels} to {channels} channels", peers)
    compare_stages(sites, rng)


if __name__ == "__main__":
    main()
