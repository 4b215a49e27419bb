"""A street of few cells."""

import numpy as np

from jaxsim.frame import Painted, Pair, PolarImage

SHAPE = (8, 60)


def street(seed: int, *, lost: float = 0.0) -> Pair:
    """Each line has a gain; red surfaces are bright; noise of 0.02; lines 6 and 7 are mostly lost."""
    random = np.random.default_rng(seed)
    row = np.broadcast_to(np.linspace(0, 1, SHAPE[0], dtype=np.float32)[:, None], SHAPE).copy()
    rgb = random.uniform(0, 1, (*SHAPE, 3)).astype(np.float32)
    range_m = random.uniform(3, 40, SHAPE).astype(np.float32)
    gain = 0.15 + 0.1 * (np.arange(SHAPE[0]) % 3)
    intensity = gain[:, None] + 0.4 * rgb[..., 0] - 0.004 * range_m + random.normal(0, 0.02, SHAPE)
    intensity = np.clip(intensity, 0.01, 0.99).astype(np.float32)
    valid = (random.random(SHAPE) > lost) & ~((np.arange(SHAPE[0]) > 5)[:, None] & (random.random(SHAPE) < 0.8))
    seen = random.random(SHAPE) > 0.1
    nothing = np.zeros(SHAPE, np.int32)
    painted = Painted(range_m, range_m, rgb, nothing, nothing, seen, np.zeros(SHAPE, bool))
    angle = random.uniform(0, 1.5, SHAPE).astype(np.float32)
    return Pair(painted, angle, row, np.where(valid, intensity, 0), PolarImage(range_m, intensity, valid))
