"""Learned curves whose law is known."""

import numpy as np

RANGE = np.exp(np.linspace(np.log(3), np.log(60), 20))


AZIMUTH = np.linspace(-3.1, 3.1, 20)


GROUPS = 12


def learned(true, *, sd: float = 0.02, seed: int = 0):
    """A curve and those without a group each, of groups that scatter about the truth; `sd` is that of the curve."""
    each = true + np.random.default_rng(seed).normal(0, sd * np.sqrt(GROUPS), (GROUPS, len(true)))
    return each.mean(0), (each.sum(0) - each) / (GROUPS - 1)
