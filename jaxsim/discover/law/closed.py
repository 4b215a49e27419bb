"""The closed formula of a learned law: the search over its knots, in the units in which people tell them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jaxsim.discover.covariates import ALTERNATING
from jaxsim.discover.law.grammar import Variable
from jaxsim.discover.law.learn import LearnedFit
from jaxsim.discover.law.search import search
from jaxsim.discover.verdict import ClosedLaw
from jaxsim.effects.learned import UNITS

VARIABLES = {
    "range": ("range_m", "m"),
    "incidence": ("incidence_rad", "rad"),
    "row": ("row", ""),
    "column": ("column", ""),
    "even rows": ("odd_row", ""),
    "even columns": ("odd_column", ""),
    "azimuth": ("azimuth_rad", "rad"),
    "power": ("power", ""),
    "intensity": ("intensity", ""),
    "step": ("depth_step", ""),
    "step side": ("side_step", ""),
    "frame": ("time_s", "s"),
    "time": ("scan_time", ""),
    "speed": ("speed_mps", "m/s"),
    "speed x time": ("way_mps", "m/s"),
    "heading": ("heading_rad", "rad"),
    "rgb": ("brightness", ""),
    "hue": ("red_minus_blue", ""),
    "hue angle": ("hue_rad", "rad"),
}
"""What a covariate is called in a formula, and its unit; classes have no formula. Of two banks the odd one counts 1."""
LOGARITHMS = ("range", "power", "intensity")
"""Covariates that are compared as logarithms; a formula takes what they are logarithms of."""


def closed_law(fitted: LearnedFit) -> ClosedLaw | None:
    """The formula of a learned law; None where none is near, or a covariate has no order."""
    learned = fitted.learned
    if not all(name in VARIABLES and name not in ALTERNATING for name in learned.covariates):
        return None
    grids = np.meshgrid(*(np.asarray(knots) for knots in learned.knots), indexing="ij")
    variables = [
        Variable(*VARIABLES[name], np.exp(grid.ravel()) if name in LOGARITHMS else grid.ravel())
        for name, grid in zip(learned.covariates, grids, strict=True)
    ]
    law = search(
        variables,
        np.asarray(learned.values),
        fitted.without,
        channel=learned.channel,
        unit=UNITS[learned.channel],
        free=fitted.free,
    )
    if law is None:
        return None
    by_variable = {VARIABLES[name][0]: name for name in learned.covariates}
    return replace(law, covariates=tuple(by_variable[name] for name in law.covariates))
