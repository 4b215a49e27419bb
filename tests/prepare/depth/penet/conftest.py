"""Fixtures that test files share."""

import numpy as np
import pytest


@pytest.fixture(scope="module")
def vectors(golden):
    return np.load(golden / "penet/penet_c2.npz")
