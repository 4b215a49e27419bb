"""Curves of residuals show what an effect explained, its mean and its scatter; maps show where on the grid."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.discover.show.pictures import Bins, _in_blocks, residual_curves, residual_maps
from jaxsim.effects import get_effect
from tests.discover.toy import judged_toy

SD_M = 0.1


@pytest.fixture(scope="module")
def noisy(standard_promotion):
    """(before, after, in_fit, scene): beyond 12 m readings scatter by 0.1 m more, which `after` knows."""
    before, in_fit, scene = judged_toy()
    ev, far = before.ev, before.ev.rays.range_m > 12
    noise = np.random.default_rng(3).normal(0, SD_M, ev.range_m.shape).astype(np.float32)
    before = replace(before, ev=replace(ev, range_m=ev.range_m + jnp.where(far, noise, 0)))
    rays = replace(ev.rays, noise_m=jnp.where(far, jnp.float32(SD_M), 0))
    return before, replace(before, ev=replace(before.ev, rays=rays)), in_fit, scene


def test_a_scatter_that_follows_the_range_shows_before_and_not_after(noisy):
    before, after, in_fit, scene = noisy
    lines = residual_curves(before, after, in_fit=in_fit, scene=scene, effects=[get_effect("range_noise")])
    spread = {line.covariate: line for line in lines if line.spread}
    assert set(spread) == {"power", "range"}
    line = spread["range"]
    far = np.exp(line.x) > 12
    assert line.before[far].mean() > line.before[~far].mean() + 0.5
    np.testing.assert_allclose(line.after, 0, atol=0.35)
    means = next(line for line in lines if line.covariate == "range" and not line.spread)
    np.testing.assert_allclose(means.before, means.after, atol=0.02)


def test_where_nothing_scatters_more_there_are_means_alone(noisy):
    before, _, in_fit, scene = noisy
    lines = residual_curves(before, before, in_fit=in_fit, scene=scene, effects=[get_effect("beam_range_bias")])
    assert [(line.channel, line.covariate, line.spread) for line in lines] == [("range", "row", False)]


def test_a_group_without_rays_has_no_mean():
    bins = Bins.of(np.array([1.0, 1, 2, 2, 3, 3]), "row", np.array([0, 0, 0, 1, 1, 1]))
    before, after, band = bins.curve(np.array([1.0, 3, 2, 4, 5, 7]), np.zeros(6))
    np.testing.assert_allclose(bins.centre, [1, 2, 3])
    np.testing.assert_allclose(before, [2, 3, 6])
    assert not after.any()
    assert np.isnan(band[[0, 2]]).all()
    assert band[1] == pytest.approx(6.314, abs=0.01)
    assert Bins.of(np.ones(9), "row", np.zeros(9, int)) is None


def test_maps_cover_the_grid_with_means_of_judge_frames(noisy):
    before, _, in_fit, scene = noisy
    maps = residual_maps(before, in_fit=in_fit)
    assert {name: one.shape for name, one in maps.items()} == dict.fromkeys(("intensity", "range", "drop"), (16, 60))
    lost = np.asarray(~before.ev.returned)[scene >= 6]
    assert np.nanmax(maps["drop"]) <= 1
    assert np.isfinite(maps["drop"]).sum() > 0.9 * maps["drop"].size
    assert (np.nanmean(maps["drop"], 1) > 0).any() == lost.any()


@pytest.mark.parametrize(("columns", "most"), [(32, 20), (40, 20), (65, 20), (300, 20), (300, 100)])
def test_a_scene_with_a_block_of_columns_shows_one(columns, most):
    blocks = _in_blocks(np.arange(columns), 32, most=most)
    assert blocks.shape[1] == 32
    assert 1 <= len(blocks) <= max(1, most // 32)
