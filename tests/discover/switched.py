"""A toy recording whose frames differ in brightness."""

from dataclasses import replace

import numpy as np

from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.read import Comparison
from tests.discover.toy import toy


def problem_with(factor, frames=16, scenes=None):
    """The null of a toy recording whose frame k has `factor[k]` times the light; of scenes of their own, or these."""
    scan, measured = toy(frames=frames)
    light = np.clip(measured.intensity * np.asarray(factor)[:, None, None], 0, 1).astype(np.float32)
    names = tuple(f"{k:02d}" for k in range(frames))
    comparison = Comparison(scan, replace(measured, intensity=light), names, scenes or names)
    return NullModel.of(Division.of(comparison)).problem
