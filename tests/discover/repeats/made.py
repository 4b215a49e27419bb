"""Made maps of residuals: some columns of each scene, elsewhere in each, noise with heavy tails, and a pattern."""

import numpy as np

from jaxsim.discover.repeats.maps import Maps

SCENES, FIND = 14, 9
ROWS, COLUMNS, SHOWN = 16, 96, 64
ROW, COLUMN = np.mgrid[:ROWS, :COLUMNS]
FINDING = np.arange(SCENES) < FIND


def maps(seed: int, pattern: np.ndarray | float = 0.0, *, shown: int = SHOWN) -> Maps:
    rng = np.random.default_rng(seed)
    weight = np.zeros((SCENES, ROWS, COLUMNS))
    for one in weight:
        column = rng.choice(COLUMNS, shown, replace=False)
        one[:, column] = rng.uniform(0.5, 1.5, (ROWS, shown)) * (rng.random((ROWS, shown)) < 0.8)
    return Maps.plain(weight, pattern + rng.standard_t(5, weight.shape))
