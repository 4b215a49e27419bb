"""Free curves along one covariate: what an effect outside the catalogue would look like, in each channel.

A free curve is a law like any other: its parameters are heights at the columns of a basis, and the rays carry the basis
of the covariate that it runs along. All bases have the same shape, so that one compiled program serves all curves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.localise import CATEGORICAL, curve_basis, values_of
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.rules import RULES
from jaxsim.effects import Law, Parameter
from jaxsim.effects.edits import brighten, lose, misread
from jaxsim.effects.rays import Array, Rays

COLUMNS = 36
"""Columns of every basis; one that needs fewer (knots, classes) is filled up with zeros."""


@dataclass(frozen=True)
class Heights(Parameter):
    """A curve's coefficients: its height at each column of a basis."""

    def dims(self, rows: int) -> tuple[int, ...]:
        """One number a column, whatever the sensor."""
        return (COLUMNS,)


def _curve(p: dict[str, Array], rays: Rays) -> Float[Array, "*n"]:
    """The curve's height at each ray. Raises ValueError for rays that carry no basis."""
    if rays.basis is None:
        raise ValueError("a free curve needs the basis of its covariate: make the problem with `with_basis`")
    return rays.basis @ p["height"]


CURVES = {
    "intensity": Law(
        name="intensity curve",
        parameters={"height": Heights(0.0, -2.0, 2.0, "nats", "change of ln I at each knot", scale=0.15)},
        channels=("intensity",),
        apply=lambda p, rays: brighten(rays, _curve(p, rays)),
    ),
    "range": Law(
        name="range curve",
        parameters={"height": Heights(0.0, -1.0, 1.0, "m", "change of the reading at each knot", scale=0.03)},
        channels=("range",),
        apply=lambda p, rays: misread(rays, _curve(p, rays)),
    ),
    "drop": Law(
        name="drop curve",
        parameters={"height": Heights(0.0, 0.0, 0.95, "", "share of echoes lost at each knot", scale=0.1)},
        channels=("drop",),
        apply=lambda p, rays: lose(rays, _curve(p, rays)),
        starts=({"height": 0.03},),
    ),
}
"""A curve a channel, along the covariate whose basis the rays carry (`with_basis`)."""


def with_basis(problem: Problem, covariate: str) -> Problem:
    """The problem whose rays carry the covariate's basis, so that the one program of a channel serves all curves."""
    rays = problem.ev.rays
    hit = np.asarray(rays.hit)
    basis = np.zeros((*hit.shape, COLUMNS), np.float32)
    basis[hit] = fixed_basis(values_of(covariate, rays, hit).astype(np.float64), covariate)
    return replace(problem, basis=jnp.asarray(basis))


def fixed_basis(x: np.ndarray, covariate: str) -> Float[np.ndarray, "n 36"]:
    """The `curve_basis` of a covariate with COLUMNS columns: filled up with zeros where it has fewer; neighbouring
    rows share one where there are more."""
    if covariate in CATEGORICAL:
        values, place = np.unique(x, return_inverse=True)
        return np.eye(COLUMNS, dtype=np.float32)[place * COLUMNS // max(len(values), COLUMNS)]
    found = curve_basis(x, covariate, 2 * RULES.knots)
    return np.pad(found, ((0, 0), (0, COLUMNS - found.shape[1])))
