"""Maps of a fitted problem: sums of weight times residual, and what levels leave of a pattern."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.model.null_model import residuals
from jaxsim.discover.repeats.maps import half_steps, maps_of, robust_slope, scales
from tests.discover.repeats.made import COLUMNS, ROWS, maps
from tests.discover.toy import judged_toy

pytestmark = pytest.mark.usefixtures("standard_promotion")


@pytest.fixture(scope="module")
def toy(standard_promotion):
    problem, in_fit, scene = judged_toy()
    columns = len(np.asarray(problem.scan.grid.azimuth_rad))
    return problem, in_fit, maps_of(problem, in_fit, scene, columns=columns)


def test_each_cell_holds_its_rays(toy):
    problem, in_fit, maps = toy
    by_channel = residuals(problem, in_fit)
    for name, weights in (("intensity", problem.equations.intensity), ("range", problem.equations.range_)):
        shown = np.asarray(weights)[2] * by_channel[name].off[2]
        column = np.asarray(problem.ev.rays.column)[2, :, 0]
        np.testing.assert_allclose(maps[name].total[2][:, column], shown.T, rtol=1e-4, atol=1e-3)
        assert not np.delete(maps[name].total[2], column, axis=1).any()


def test_levels_of_strips_leave_less_of_columns_than_of_rows(toy):
    maps = toy[2]["intensity"]
    row, column = np.mgrid[: maps.total.shape[1], : maps.total.shape[2]]
    share = [
        (pattern * maps.response(pattern)).sum() / (maps.weight * pattern**2).sum()
        for pattern in (1.0 - 2 * (row % 2), 1.0 - 2 * (column // 2 % 2))
    ]
    assert 0 < share[1] < share[0] < 1


def test_rounding_is_off_by_more_on_dark_surfaces(toy):
    problem, in_fit, maps = toy
    assert half_steps(problem.ev) == {"intensity": 0.0, "range": 0.0}
    assert maps["intensity"].coarse is None
    ev = problem.ev
    rounded = jnp.log(jnp.maximum(jnp.round(jnp.exp(ev.log_intensity) * 100), 1) / 100)
    ev = replace(ev, log_intensity=rounded, own_step=jnp.array([0.0, 0.02]))
    assert half_steps(ev) == pytest.approx({"intensity": 0.005, "range": 0.01}, rel=1e-3)
    made = maps_of(replace(problem, ev=ev), in_fit, np.arange(9), columns=maps["range"].total.shape[2])
    assert made["range"].coarse is not None
    assert made["intensity"].coarse is not None
    np.testing.assert_allclose(made["range"].coarse[maps["range"].weight.sum(0) > 0], 0.01)
    light = np.exp(np.asarray(ev.rays.log_intensity))
    off = made["intensity"].coarse[made["intensity"].weight.sum(0) > 0]
    assert 0.004 / light.max() < off.min()
    assert off.min() < 0.9 * off.max()


def test_drops_have_no_levels(toy):
    maps = toy[2]["drop"]
    np.testing.assert_allclose(maps.response(np.ones(maps.total.shape[1:])), maps.weight)


def test_the_slope_is_that_of_weight_times_residual():
    z = np.random.default_rng(0).standard_t(4, 100_000)
    weight = 5 / (4 + z**2) / 0.01
    shifted = (z + 1e-3) * 5 / (4 + (z + 1e-3) ** 2) / 0.01
    numeric = (shifted - z * weight).sum() / 1e-3 / weight.sum()
    assert robust_slope(weight, np.full(z.shape, 0.01)) == pytest.approx(numeric, abs=0.01)


SCALES = {(one.name, one.along): one for one in scales(ROWS, COLUMNS)}


def patterns_of(key):
    pattern = SCALES[key].pattern
    assert pattern
    return pattern


SINGLE = [key for key, one in SCALES.items() if one.pattern]


@pytest.mark.parametrize("key", SINGLE, ids="-".join)
def test_a_sum_is_that_of_its_pattern(key):
    total = maps(0).total[:2]
    scale = SCALES[key]
    sums = scale.sums(total)
    for k in {0, sums.shape[1] // 2, sums.shape[1] - 1}:
        pattern = patterns_of(key)(k, 1.0)
        shown = sum(pattern[r, c] * total[:, r, c] for r in range(ROWS) for c in range(COLUMNS))
        np.testing.assert_allclose(np.real(sums[:, k]), shown, atol=1e-8)


@pytest.mark.parametrize("key", SINGLE, ids="-".join)
def test_information_is_the_mean_square_of_a_pattern(key):
    weight = np.ones((3, ROWS, COLUMNS))
    scale = SCALES[key]
    squares = (patterns_of(key)(0, 1.0) ** 2).sum() * 3
    # A wave's sum has a real and an imaginary part.
    assert scale.information(weight)[0] == pytest.approx(squares * (2 if key[0] == "wave" else 1))


def test_a_wave_has_the_phase_of_its_sum():
    scale = SCALES["wave", "column"]
    pattern = patterns_of(("wave", "column"))
    made = pattern(9, np.exp(0.7j))[None]
    assert np.angle(scale.sums(made)[0, 9]) == pytest.approx(0.7, abs=0.1)
    assert pattern(9, scale.sums(made)[0, 9]) == pytest.approx(made[0], abs=0.1)
