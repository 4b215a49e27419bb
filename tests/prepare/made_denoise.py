"""What tests of denoise are made of."""

import numpy as np

SHAPE = (24, 60)


def noisy(seed=0, noise=0.05):
    rng = np.random.default_rng(seed)
    clean = np.where(np.arange(SHAPE[1]) < 30, 0.25, 0.65) * np.ones(SHAPE)
    return clean, np.clip(clean + noise * rng.normal(size=SHAPE), 0, 0.99).round(2).astype(np.float32)
