"""What tests of export are made of."""

import numpy as np

from jaxsim.frame import Cloud


def cloud():
    rng = np.random.default_rng(0)
    xyz = rng.normal(0, 10, (50, 3)).astype(np.float32)
    return Cloud(xyz, rng.random(50, dtype=np.float32), rng.random(50) < 0.8)


def lined():
    """A cloud with laser lines, and times of its points."""
    rng = np.random.default_rng(1)
    return cloud().replace(row=rng.integers(0, 64, 50).astype(np.int32)), rng.random(50).astype(np.float32) / 10
