"""What tests of generation are made of."""

import numpy as np


def clouds(seed: int, n: int, points: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.standard_normal((n, points, 3)) * [20, 15, 1]).astype(np.float32)
