"""Mean errors do not see scatter and lattices; likelihoods do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from jaxsim.discover.model.likelihood import DEGREES
from jaxsim.discover.show.distance import distance
from tests.discover.conftest import judged_toy


@pytest.fixture(scope="module")
def judged(standard_promotion):
    return judged_toy()


def test_errors_are_those_of_the_residuals_and_likelihoods_those_of_their_law(judged):
    found, fitted, unit = judged
    told = distance(found, fitted, found.equations, unit)
    # The toy's sensor has range noise of 2 cm and loses one ray in a hundred.
    np.testing.assert_allclose(told.error[:, 1].mean(), 0.02 * np.sqrt(2 / np.pi), rtol=0.1)
    rays = 30 * 16
    law = stats.t(DEGREES, scale=0.86 * 0.02)
    expected = rays * law.logpdf(np.random.default_rng(0).normal(0, 0.02, 100_000)).mean()
    np.testing.assert_allclose(told.log_likelihood[:, 1].mean(), expected, rtol=0.1)
    lost = np.asarray(~found.ev.returned)[unit >= 6].sum((1, 2))
    np.testing.assert_allclose(told.log_likelihood[:, 2], lost * np.log(0.01) + (rays - lost) * np.log(0.99), rtol=0.2)


def test_noise_of_the_right_size_gains_and_errors_stay(judged):
    found, fitted, unit = judged
    loud = replace(found, noise=replace(found.noise, range_=found.noise.range_ + 0.7))
    right, wrong = (distance(one, fitted, found.equations, unit) for one in (found, loud))
    assert (right.log_likelihood - wrong.log_likelihood)[:, 1].min() > 20
    np.testing.assert_array_equal(right.error[:, 1], wrong.error[:, 1])
