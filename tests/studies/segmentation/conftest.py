"""A wall whose classes differ in nothing but intensity, and a small study of it."""

import numpy as np
import pytest

from jaxsim.config import GeneratorConfig, SegmentationConfig
from jaxsim.studies.segmentation.study import INTENSITIES, Study


@pytest.fixture(scope="package")
def folder(tmp_path_factory):
    """Six images of a flat wall painted in blocks of two classes: 1 reports 0.2, 2 reports 0.8."""
    folder, random = tmp_path_factory.mktemp("images"), np.random.default_rng(0)
    for k in range(6):
        cells = np.full((4, 16, 6), 5.0, np.float32)
        label = random.integers(1, 3, (4, 8)).repeat(2, 1)
        cells[..., 3] = np.where(label == 1, 0.2, 0.8) + random.normal(0, 0.02, label.shape)
        cells[..., 5] = label
        cells[0, 0, 3:] = 0
        np.savez(folder / f"{k:02d}.npz", scan=cells)
    return folder


@pytest.fixture(scope="package")
def study(folder, tmp_path_factory):
    """Part 0 judged, by each kind."""
    config = SegmentationConfig(
        root=folder,
        network=GeneratorConfig(form="unet", filters=4, downsamples=0, enhancers=0),
        steps=40,
        sensor_steps=80,
        batch=4,
        columns=8,
        lr=3e-2,
        out=tmp_path_factory.mktemp("out"),
    )
    study = Study.of_folders(config, folder, None)
    for kind in INTENSITIES:
        study.score(kind, 0, 0)
    return study
