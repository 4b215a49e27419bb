""""""

import numpy as np
import pytest

from jaxsim.discover.model.noise_levels import lattice_step, noise_levels
from tests.discover.noisy_street import scan

NOISY = {"share": 0.06, "constant": 0.008, "range_m": 0.015, "loss": 0.01, "step": 1 / 255}


def test_an_ideal_simulator_has_no_noise():
    levels = noise_levels(scan()[0])
    assert (levels.range_m, levels.intensity, levels.intensity_share, levels.loss) == (0, 0, 0, 0)


def test_levels_are_read_off_the_frames():
    levels = noise_levels(scan(NOISY)[0])
    assert levels.range_m == pytest.approx(0.015, rel=0.1)
    assert levels.intensity_share == pytest.approx(0.06, rel=0.25)
    assert levels.intensity == pytest.approx(np.hypot(0.008, 1 / 255 / np.sqrt(12)), rel=0.3)
    assert levels.loss == pytest.approx(0.01, rel=0.3)
    assert levels.intensity_step == pytest.approx(1 / 255, rel=1e-3)
    assert levels.range_step_m == 0


def test_noise_that_is_the_same_for_all_is_told_where_dark_surfaces_alone_show_it():
    """Of the darkest readings it is half of the noise, of all others next to nothing."""
    levels = noise_levels(scan({"share": 0.15, "constant": 0.004})[0])
    assert levels.intensity == pytest.approx(0.004, rel=0.15)
    assert levels.intensity_share == pytest.approx(0.15, rel=0.1)
    assert noise_levels(scan({"share": 0.15})[0]).intensity == 0


@pytest.mark.parametrize("range_m", [0.01, 0.03, 0.08])
def test_range_noise_alone_is_told_whatever_its_size(range_m):
    levels = noise_levels(scan({"range_m": range_m})[0])
    assert levels.range_m == pytest.approx(range_m, rel=0.1)
    assert not levels.of_intensity


def test_rounding_alone_is_a_lattice_and_no_noise_of_the_range():
    levels = noise_levels(scan({"step": 1 / 255})[0])
    assert levels.intensity_step == pytest.approx(1 / 255, rel=1e-3)
    assert levels.range_m == 0
    assert levels.intensity < 1 / 255


def test_too_few_rays_say_nothing():
    few = scan(NOISY, frames=1)[0]
    tiny = few.replace(hit=few.hit & (np.arange(few.hit.shape[2]) < 6)[None, None])
    levels = noise_levels(tiny)
    assert (levels.range_m, levels.intensity_share, levels.loss) == (0, 0, 0)


@pytest.mark.parametrize("step", [0.004, 1 / 255, 0.01, 0.05])
def test_a_lattice_is_found_in_float32_values(step):
    rng = np.random.default_rng(1)
    values = np.round(rng.uniform(0, 1, 5000) / step) * step
    assert lattice_step(values.astype(np.float32), finest=1e-3) == pytest.approx(step, rel=1e-3)


def test_values_on_no_lattice_have_none():
    assert lattice_step(np.random.default_rng(2).uniform(0, 80, 5000), finest=1e-3) == 0


def test_a_few_values_off_the_lattice_do_not_hide_it_and_many_do():
    rng = np.random.default_rng(3)
    values = np.round(rng.uniform(0, 1, 5000) / 0.02) * 0.02
    values[:10] += 0.007
    assert lattice_step(values, finest=1e-3) == pytest.approx(0.02, rel=1e-3)
    # At other places than each other's, too.
    values[10:25] += rng.uniform(0, 0.02, 15)
    assert lattice_step(values, finest=1e-3) == pytest.approx(0.02, rel=1e-3)
    values[:500] += rng.uniform(0, 0.02, 500)
    assert lattice_step(values, finest=1e-3) == 0
