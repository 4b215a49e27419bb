"""Residuals of a null that lacks nothing."""

import numpy as np
import pytest

from jaxsim.discover.model.likelihood import CHANNELS
from jaxsim.discover.model.residuals import residuals, spread, standardised
from tests.discover.conftest import judged_toy

pytestmark = pytest.mark.usefixtures("standard_promotion")


@pytest.fixture(scope="module")
def null(standard_promotion):
    problem, fitted, _ = judged_toy()
    return problem, fitted


def test_each_channel_is_standardised_where_it_counts_and_keeps_its_unit(null):
    by_channel = residuals(*null)
    assert tuple(by_channel) == CHANNELS
    for one in by_channel.values():
        assert one.counts.any()
        assert np.isfinite(one.z[one.counts]).all()
        assert one.z[one.counts].std() == pytest.approx(1, abs=1e-3)
    # The toy's sensor has 8 % and 2 cm; levels and poses take up a little.
    assert by_channel["intensity"].off[by_channel["intensity"].counts].std() == pytest.approx(0.08, rel=0.2)
    assert by_channel["range"].off[by_channel["range"].counts].std() == pytest.approx(0.02, rel=0.2)


def test_a_lost_ray_is_off_by_the_probability_that_it_returns(null):
    problem, _ = null
    drop = residuals(*null)["drop"]
    p, lost = np.asarray(spread(problem.ev, problem.noise)[2]), ~np.asarray(problem.ev.returned)
    np.testing.assert_allclose(drop.off, np.where(lost, 1 - p, -p), atol=1e-6)
    np.testing.assert_array_equal(np.sign(drop.z[drop.counts]), np.where(lost, 1, -1)[drop.counts])


def test_the_standardised_ones_are_on_the_host(null):
    rays, by_channel = standardised(*null)
    assert isinstance(rays.range_m, np.ndarray)
    for name, one in residuals(*null).items():
        np.testing.assert_array_equal(by_channel[name][0], one.z)
