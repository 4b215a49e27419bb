"""Intervals over scenes."""

import numpy as np
import pytest

from jaxsim.metrics.intervals import mean_interval
from jaxsim.metrics.paired import difference_of, frame_sums, scene_intervals

SHAPE = (8, 60)


def test_intervals_over_scenes_are_those_of_equal_scenes_means():
    """Scenes of equally many cells: the jackknife of the mean is Student's t of their means."""
    random = np.random.default_rng(0)
    truth = np.full(SHAPE, 0.5, np.float32)
    every = np.ones(SHAPE, bool)
    off = random.uniform(0.02, 0.1, 5).astype(np.float32)
    frames = [frame_sums(truth + x, ~every, y=truth, returned=every, m=every) for x in off]
    scenes = list("abcde")
    np.testing.assert_allclose(scene_intervals(frames, scenes)["mae"], mean_interval(off.astype(float)), rtol=1e-4)
    assert scene_intervals(frames, ["a"] * 5) == {}
    value, low, high = difference_of(frames, frames[::-1], scenes)
    assert value == pytest.approx(0, abs=1e-9)
    assert low < 0 < high
    # The same difference in every scene has no scatter, however scenes differ.
    more = [frame_sums(truth + x + 0.01, ~every, y=truth, returned=every, m=every) for x in off]
    assert difference_of(more, frames, scenes) == pytest.approx((0.01, 0.01, 0.01), rel=1e-3)
