"""Covariates of rays, by both kinds of arrays."""

import jax
import numpy as np
import pytest

from jaxsim.effects import all_rays
from jaxsim.effects.rays import READ, covariates
from tests.effects.streets import clutter_of_everything


@pytest.mark.parametrize("name", READ)
def test_a_covariate_is_read_as_discover_compares_it(name):
    rays = all_rays(clutter_of_everything())
    np.testing.assert_allclose(
        np.asarray(READ[name](rays)), covariates(np)[name](jax.device_get(rays)), rtol=2e-5, atol=2e-5
    )
