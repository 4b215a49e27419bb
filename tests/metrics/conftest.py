"""Fixtures that test files share."""

import json

import numpy as np
import pytest


@pytest.fixture(scope="module")
def published(golden):
    folder = golden / "lidar_metrics"
    with np.load(folder / "clouds.npz") as archive:
        arrays = dict(archive)
    return arrays, json.loads((folder / "values.json").read_text())
