"""Non-local means."""

import numpy as np

from jaxsim.prepare import denoise
from tests.prepare.made_denoise import noisy

SHAPE = (24, 60)


def test_non_local_means_takes_noise_and_leaves_edges():
    clean, intensity = noisy()
    smooth = denoise(intensity, np.ones(SHAPE, bool), "non_local_means")
    assert np.abs(smooth - clean).mean() < 0.4 * np.abs(intensity - clean).mean()
    assert (smooth[:, 31] - smooth[:, 28] > 0.35).all()
