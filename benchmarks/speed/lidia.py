"""LIDIA on a LiDAR's window, 44 x 372 cells: jaxsim against the same network in PyTorch, where that is installed.

    python benchmarks/speed/lidia.py WEIGHTS.npz [ROUNDS]

WEIGHTS.npz is a file that `jaxsim convert lidia` wrote. The peer is written here from the paper: brute-force search
over 841 shifts by box-filtered differences, `torch.topk`, and the layers as `torch.nn.functional` has them; both run in
float32 on the same threads, or on the GPU where both have one, and give the same image (the largest and mean difference
are printed).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from timing import interleave

from jaxsim.compilation import enable_compilation_cache
from jaxsim.prepare.denoise.lidia import apply, open_lidia, to_published

SHAPE, RADIUS, NEAR = (44, 372), 14, 14


def in_torch(arrays: dict[str, np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """The grey network, stored statistics."""
    import torch
    import torch.nn.functional as f

    device = "cuda" if torch.cuda.is_available() and jax.default_backend() == "gpu" else "cpu"
    torch.set_default_device(device)
    w = {name: torch.from_numpy(np.array(array)).to(device) for name, array in arrays.items()}
    kernel = torch.tensor([0.25, 0.5, 0.25])
    kernel = (kernel[:, None] * kernel)[None, None]

    def ver_hor(name: str, x: torch.Tensor) -> torch.Tensor:
        x = f.linear(x, w[f"{name}.ver.weight"])
        return f.linear(x.transpose(-1, -2), w[f"{name}.hor.weight"]).transpose(-1, -2) + w[f"{name}.b"]

    def norm(name: str, x: torch.Tensor) -> torch.Tensor:
        parts = (w[f"{name}.{part}"] for part in ("running_mean", "running_var", "weight", "bias"))
        return f.batch_norm(x, *parts)

    def block(name: str, x: torch.Tensor) -> torch.Tensor:
        x = ver_hor(f"{name}.ver_hor", x)
        return f.relu(norm(f"{name}.bn", x) if f"{name}.bn.weight" in w else x)

    def blended(name: str, x: torch.Tensor, first: str, second: str) -> torch.Tensor:
        x = block(f"{name}.{first}", x)
        return x if f"{name}.a" not in w else w[f"{name}.a"] * x + (1 - w[f"{name}.a"]) * block(f"{name}.{second}", x)

    def weights(name: str, x: torch.Tensor) -> torch.Tensor:
        for k in range(6):
            x = f.relu(norm(f"{name}.bn{k}", f.linear(x, w[f"{name}.fc{k}.weight"])))
        return f.linear(x, w[f"{name}.fc_out.weight"], w[f"{name}.fc_out.bias"])

    def scale(image: torch.Tensor, d: int) -> tuple[torch.Tensor, torch.Tensor, tuple[int, int]]:
        """Neighbours (n, 14, 49) and what enters the weights net (n, 14)."""
        h, wide = image.shape[2:]
        rows, columns = h - 6 * d, wide - 6 * d
        far, ones = f.pad(image, [RADIUS * d] * 4, value=-1.0), torch.ones(1, 1, 7, 7)
        shifts = [
            f.conv2d((far[..., d * i : d * i + h, d * j : d * j + wide] - image) ** 2, ones, dilation=d)
            for i in range(2 * RADIUS + 1)
            for j in range(2 * RADIUS + 1)
        ]
        found, shift = torch.topk(torch.cat(shifts, 1)[0].flatten(1).T, NEAR, largest=False)
        place = torch.arange(rows)[:, None] * (far.shape[3] - 6 * d) + torch.arange(columns)
        side = 2 * RADIUS + 1
        index = place.flatten()[:, None] + d * (shift // side * (far.shape[3] - 6 * d) + shift % side)
        patches = f.unfold(far, 7, dilation=d)[0].T[index]
        own = patches[:, 0].var(-1, keepdim=True) * 49
        return patches, torch.cat([found[:, 1:], own], 1), (rows, columns)

    def agreed(x: torch.Tensor, size: tuple[int, int], d: int) -> torch.Tensor:
        size = (size[0] + 6 * d, size[1] + 6 * d)
        x = x.T[None]
        image = f.fold(x, size, 7, dilation=d) / f.fold(torch.ones_like(x), size, 7, dilation=d)
        if d == 2:
            image = f.conv2d(f.pad(image, [1] * 4, mode="reflect"), kernel)
        return f.unfold(image, 7, dilation=d)[0].T[:, None]

    @torch.no_grad()
    def run(picture: np.ndarray) -> np.ndarray:
        image, net = torch.from_numpy(picture).to(device)[None, None], "separable_fc_net"
        mean = image.mean()
        image = image - mean
        near0, in0, size = scale(f.pad(image, [6] * 4, mode="reflect"), 1)
        near1, in1, _ = scale(f.conv2d(f.pad(image, [10] * 4, mode="reflect"), kernel), 2)
        w0 = weights("weights_net0", torch.exp(-w["alpha0"].abs() * in0))[..., None]
        w1 = weights("weights_net1", torch.exp(-w["alpha1"].abs() * in1))[..., None]
        x0 = blended(f"{net}.sep_part1_s0", near0 * w0, "ver_hor_bn_re0", "ver_hor_bn_re1")
        x1 = blended(f"{net}.sep_part1_s1", near1 * w1, "ver_hor_bn_re0", "ver_hor_bn_re1")
        y0 = agreed(ver_hor(f"{net}.ver_hor_agg0_pre", x0)[:, 0], size, 1)
        y1 = w1[:, :1] * agreed((ver_hor(f"{net}.ver_hor_agg1_pre", x1) / w1[:, :1])[:, 0], size, 2)
        more = [block(f"{net}.ver_hor_bn_re_agg{k}_post", y) for k, y in enumerate((y0, y1))]
        x = blended(f"{net}.sep_part2", torch.cat([x0, x1, *more], 1), "ver_hor_bn_re2", "ver_hor_bn_re3")
        clean = near0[:, 0] - ver_hor(f"{net}.sep_part2.ver_hor_out", x)[:, 0]
        share = torch.exp(-w["beta"].abs() * clean.var(-1, unbiased=False))[:, None]
        size = (size[0] + 6, size[1] + 6)
        total = f.fold((clean * share).T[None], size, 7) / f.fold(share.expand(-1, 49).T[None], size, 7)
        return (total[0, 0, 6:-6, 6:-6] + mean).cpu().numpy()

    return run


def main(path: Path, rounds: int) -> None:
    network = open_lidia(path)
    image = np.random.default_rng(0).uniform(-1, 1, SHAPE).astype(np.float32)
    known = np.random.default_rng(1).random((1, *SHAPE)) < 0.85
    batch = image[None, ..., None]

    def ours(statistics: str, measured: np.ndarray | None = None) -> object:
        return jax.block_until_ready(
            apply(network.values, batch, measured, variant=network.variant, statistics=statistics)  # type: ignore
        )

    peers: dict[str, Callable[[], object]] = {
        "jaxsim, stored": lambda: ours("stored"),
        "jaxsim, image": lambda: ours("image"),
        "jaxsim, stored, masked": lambda: ours("stored", known),
        "jaxsim, image, masked": lambda: ours("image", known),
    }
    try:
        peer = in_torch(to_published(network.values))
    except ModuleNotFoundError:
        print("PyTorch is not installed; pip install -e '.[bench]' for the comparison")
    else:
        off = np.abs(np.asarray(ours("stored"))[0, ..., 0] - peer(image))  # type: ignore[index]
        print(f"difference: mean {off.mean():.2e}, largest {off.max():.2e} (on [-1, 1])")
        peers["torch, stored"] = lambda: peer(image)
    name = "small" if network.variant.small else "full"
    interleave(f"LIDIA, {name}, {SHAPE[0]} x {SHAPE[1]}", peers, rounds=rounds, warmup=1)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        raise SystemExit(__doc__)
    enable_compilation_cache()
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) == 3 else 7)
