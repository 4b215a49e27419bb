"""A dependence outside the catalogue: the best free curve, where it gains clearly more than any effect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.localise import Place
from jaxsim.discover.name.unexplained import shape_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.unpaired.conditional import Conditional
from jaxsim.discover.unpaired.law import solve
from jaxsim.discover.unpaired.select import Candidate, Choice
from jaxsim.discover.verdict import Unexplained

CURVES = ("range", "incidence", "azimuth")
"""Free curves that are no effect of the catalogue; one along the row is beam_gain."""
DRAWS = 100
"""Of the bootstrap over scenes that a curve's band is taken from, the curve itself included."""
NORMAL_REACH = 1.645
"""Standard deviations to either side within which a normal number lies with 90 %."""


def outside_catalogue(problem: Conditional, choice: Choice, curves: Sequence[Candidate]) -> Unexplained | None:
    """The best free curve if it gains so much more than the best effect that it is none of them."""
    good = [one for one in curves if one.accepted and one.name in CURVES]
    best = choice.steps[0].chosen.total if choice.steps else 0.0
    if good and good[0].total > RULES.unpaired_curve_factor * best + RULES.curve_margin_nats:
        return _described(problem, good[0])
    return None


def _described(problem: Conditional, curve: Candidate) -> Unexplained:
    """The curve on the find scenes, at its knots."""
    name = curve.name
    basis = curve.term.columns.columns
    scenes = np.flatnonzero(problem.find)
    rng = np.random.default_rng(0)
    fits = [_heights(problem, curve, problem.weight)]
    for _ in range(DRAWS - 1):
        drawn = rng.choice(scenes, len(scenes))
        fits.append(_heights(problem, curve, np.bincount(drawn, minlength=len(problem.find)).astype(float)))
    # A knot lies where its hat function is high.
    x = problem.comparison.covariates[name]
    knots = np.array([np.average(x, weights=basis[:, k] ** 4 + 1e-12) for k in range(basis.shape[1])])
    order = np.argsort(knots)
    y = fits[0][order]
    band = NORMAL_REACH * np.std(fits[1:], axis=0)[order]
    place = Place("intensity", name, curve.chance, 0.0, curve.total)
    character, formula = shape_of(knots[order], y, basis.sum(0)[order], place=place)
    formula += " (x: ln of range in m)" if name == "range" else f" (x: {name})"
    return Unexplained("intensity", name, character, formula, tuple(knots[order]), tuple(y), tuple(band))


def _heights(problem: Conditional, curve: Candidate, weight: Float[np.ndarray, " s"]) -> Float[np.ndarray, " k"]:
    """The curve's coefficients in so weighted scenes."""
    solution = solve(problem.equations.pooled(weight, problem.measured), [problem.nuisance, curve.term.block])
    return solution.side[len(problem.nuisance.columns) :]
