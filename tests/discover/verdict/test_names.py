"""Every name is one of a covariate that rays have."""

import numpy as np

from jaxsim.discover.verdict.names import ALTERNATING, CATEGORICAL, HUE_ANGLE, NAMED
from jaxsim.effects.rays import covariates

KNOWN = {*covariates(np)}


def test_all_names_are_covariates():
    assert {*CATEGORICAL, *ALTERNATING, HUE_ANGLE, *NAMED} <= KNOWN


def test_a_finer_look_is_called_by_one_that_is_coarser_itself():
    assert {*NAMED.values()} <= KNOWN - {*NAMED}
