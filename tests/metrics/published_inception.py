"""Inception state dicts drawn by the rule of the golden vectors' README."""

from pathlib import Path

import numpy as np


def drawn(golden: dict[str, np.ndarray], prefix: str, seed: int) -> dict[str, np.ndarray]:
    """Every tensor of the published state dict, from its listed name and shape."""
    generator, arrays = np.random.default_rng(seed), {}
    for name, text in zip(golden[f"{prefix}_check_name"], golden[f"{prefix}_check_shape"], strict=True):
        name, shape = str(name), tuple(int(n) for n in str(text).split("x") if n)
        if name.endswith("num_batches_tracked"):
            arrays[name] = np.zeros((), np.int64)
            continue
        x = generator.standard_normal(shape)
        if name.endswith("weight") and len(shape) > 1:
            x = x / np.sqrt(np.prod(shape[1:]))
        elif name.endswith(("bias", "running_mean")):
            x = 0.1 * x
        else:
            x = 0.5 + np.abs(x) if name.endswith("running_var") else 1 + 0.1 * x
        gain = np.float32(np.sqrt(2)) if name.endswith(".conv.weight") else np.float32(1)
        arrays[name] = x.astype(np.float32) * gain
    return arrays


def read_golden(folder: Path) -> dict[str, np.ndarray]:
    with np.load(folder / "inception_fid" / "inception_features.npz") as archive:
        return dict(archive)
