"""PENet's training: processor time of an update of each stage, and of its transposed convolution in two forms.

    python benchmarks/speed/penet.py [--width 8] [--crop 96 320] [--batch 2] [--rounds 5]
        [--parts branches refinement joint]

`spread` is XLA's convolution of an input with zeros in between, as the layer could also be written.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from timing import interleave

from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import Part, PenetConfig
from jaxsim.frame import DepthFrame
from jaxsim.prepare.depth.penet import layers
from jaxsim.prepare.depth.penet.training import create_state, train_step


def spread(x: Any, kernel: Any) -> Any:
    return jax.lax.conv_general_dilated(
        x, kernel, (1, 1), ((2, 3), (2, 3)), lhs_dilation=(2, 2), dimension_numbers=("NHWC", "HWIO", "NHWC")
    )


def frames(batch: int, crop: Sequence[int], seed: int = 0) -> DepthFrame:
    """Random rasters: times do not depend on what stands in them."""
    rng = np.random.default_rng(seed)
    size = (batch, *crop)
    truth = rng.uniform(3, 80, size).astype(np.float32)
    given = rng.random(size) < 0.04
    rgb = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
    camera = np.tile(np.array([[721, 0, crop[1] / 2], [0, 721, crop[0] / 2], [0, 0, 1]], np.float32), (batch, 1, 1))
    return DepthFrame(rgb, np.where(given, truth, 0), given, truth, rng.random(size) < 0.6, camera)


def main(width: int, crop: Sequence[int], batch: int, rounds: int, parts: Sequence[Part]) -> None:
    rng = np.random.default_rng(0)
    for k in (0, 2, 4):
        size = (batch, crop[0] >> (k + 1), crop[1] >> (k + 1), width << (k + 1))
        x, kernel = (
            jnp.asarray(rng.standard_normal(s, np.float32)) for s in (size, (5, 5, width << (k + 1), width << k))
        )
        peers: dict[str, Callable[[], object]] = {}
        for name, form in (("doubled", layers._doubled), ("spread", spread)):
            learn = jax.jit(jax.value_and_grad(lambda x, kernel, form=form: (form(x, kernel) ** 2).sum(), (0, 1)))
            peers[name] = lambda learn=learn, x=x, kernel=kernel: jax.block_until_ready(learn(x, kernel))
        interleave(f"transposed convolution of {size}, value and gradients", peers, rounds=rounds)

    config, given = PenetConfig(width=width, start_m=15.0), frames(batch, crop)
    lr, weight = jnp.float32(1e-3), jnp.float32(0.1)
    updates: dict[str, Callable[[], object]] = {}
    for part in parts:
        kept = [create_state(config, 0)]

        def update(part: Part = part, kept: list = kept) -> None:
            kept[0], metrics = train_step(kept[0], given, lr, weight=weight, config=config, part=part)
            jax.block_until_ready(metrics)

        updates[part] = update
    if updates:
        interleave(f"an update, {batch} x {crop[0]} x {crop[1]}, width {width}", updates, rounds=rounds, warmup=1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=8)
    parser.add_argument("--crop", type=int, nargs=2, default=(96, 320), metavar=("ROWS", "COLUMNS"))
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--parts", nargs="*", default=["branches", "refinement", "joint"])
    arguments = vars(parser.parse_args())
    enable_compilation_cache()
    main(**arguments)
