"""Two folders of different streets."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.discover.unpaired.read import _bent_by_rounding, read_unpaired, roughness_m
from tests.discover.unpaired.made import SMALL


def test_noise_of_ranges_is_read_off_planes():
    rng = np.random.default_rng(0)
    azimuth = np.linspace(-0.5, 0.5, 200)
    wall = np.broadcast_to(10 / np.cos(azimuth), (50, 200))
    noisy = wall + rng.normal(0, 0.02, wall.shape)
    assert roughness_m(noisy, np.ones(wall.shape, bool)) == pytest.approx(0.02, rel=0.05)
    assert roughness_m(wall, np.ones(wall.shape, bool)) < 1e-3


def test_what_is_dark_beside_a_coarse_lattice_is_compared_on_neither_side(tmp_path, standard_promotion):
    folder = tmp_path / "case"
    key = make_unpaired(folder, effect="intensity_quantization", severity=8.0, seed=4, **SMALL)
    step = key.effects[0]["parameters"]["step"]
    comparison = read_unpaired(folder / "simulated", folder / "measured", per_scene=200)
    assert comparison.steps["intensity_quantization"] == pytest.approx(step, rel=1e-3)
    in_steps = np.exp(comparison.log_intensity) / step
    np.testing.assert_allclose(in_steps, np.round(in_steps), atol=0.01)
    lowest = [in_steps[comparison.measured[comparison.scene] == side].min() for side in (False, True)]
    assert lowest[0] == pytest.approx(lowest[1], abs=0.01)
    assert lowest[0] > 1.5


@pytest.mark.parametrize(("readings", "dark"), [([0, 0.1, 0.2, 0.6, 0.7], 0.35), ([0, 0.1, 0.1, 0.1, 0.2], 0.075)])
def test_a_quarter_of_the_rounded_readings_stay_however_dark_they_are(readings, dark):
    side = SimpleNamespace(readings=lambda field: np.array(readings))
    assert inspect.unwrap(_bent_by_rounding)(side, {"intensity_quantization": 0.1}) == pytest.approx(dark)
    assert inspect.unwrap(_bent_by_rounding)(side, {}) == 0
