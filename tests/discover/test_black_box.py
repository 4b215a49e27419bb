"""A black box of the right covariate reaches the noise, in errors and in likelihood, and touches no other channel."""

import jax
import numpy as np
import pytest

from jaxsim.discover.black_box import black_box
from jaxsim.discover.distance import distance
from jaxsim.discover.likelihood import CHANNELS
from jaxsim.discover.residuals import residuals

from .conftest import judged_toy


@pytest.fixture(scope="module")
def both():
    found, fitted, unit = judged_toy(gain=0.3)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        free = black_box(found, fitted, ["row"])
        assert list(residuals(found, fitted)) == list(CHANNELS)
        return [distance(problem, fitted, found.weights, unit) for problem in (found, free)]


def test_along_the_rows_it_takes_beam_gains_and_leaves_ranges(both):
    before, floor = (one.error.mean(0) for one in both)
    assert floor[0] < 0.5 * before[0]
    np.testing.assert_allclose(floor[1], before[1], rtol=0.2)


def test_the_likelihood_of_every_scene_gains_by_it(both):
    gained = both[1].log_likelihood - both[0].log_likelihood
    assert (gained[:, 0] > 50).all()
    assert (np.abs(gained[:, 1:]) < 10).all()
