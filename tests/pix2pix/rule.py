"""Weights drawn by the rule of the golden README, under their published names."""

import numpy as np

from jaxsim.pix2pix.losses import VGG_BLOCKS


def draw(shapes: dict[str, tuple[int, ...]], seed: int) -> dict[str, np.ndarray]:
    """Kernels and biases of convolutions from one seed, names in sorted order."""
    generator = np.random.default_rng(seed)
    weights = {}
    for name in sorted(shapes):
        x = generator.standard_normal(shapes[name])
        scale = 0.1 if name.endswith("bias") else 1 / np.sqrt(np.prod(shapes[name][1:]))
        weights[name] = (x * scale).astype(np.float32)
    return weights


def draw_vgg(seed: int) -> dict[str, np.ndarray]:
    """VGG-19's first thirteen convolutions, in torchvision's names and layouts."""
    shapes, channels = {}, 3
    for block, places in enumerate(VGG_BLOCKS):
        width = min(64 * 2**block, 512)
        for place in places:
            shapes[f"features.{place}.weight"] = (width, channels, 3, 3)
            shapes[f"features.{place}.bias"] = (width,)
            channels = width
    return draw(shapes, seed)
