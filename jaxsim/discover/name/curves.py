"""Free curves along one covariate: what an effect outside the catalogue would look like, in each channel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.localise import CATEGORICAL, curve_basis, values_of
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.rules import RULES
from jaxsim.effects import Effect, Parameter
from jaxsim.effects.edits import brighten, lose, misread
from jaxsim.effects.rays import Array, Rays

COLUMNS = 36
"""Of every basis: knots, classes; bases of fewer are filled with zeros, so that curves are compiled once."""


@dataclass(frozen=True)
class Curve(Parameter):
    """Heights at the columns of a basis."""

    def dims(self, rows: int) -> tuple[int, ...]:
        return (COLUMNS,)


def _dim(p: dict[str, Array], rays: Rays, basis: Any) -> Rays:
    return brighten(rays, basis @ p["height"])


def _misread(p: dict[str, Array], rays: Rays, basis: Any) -> Rays:
    return misread(rays, basis @ p["height"])


def _lose(p: dict[str, Array], rays: Rays, basis: Any) -> Rays:
    return lose(rays, basis @ p["height"])


def _curve(channel: str, unit: str, scale: float, low: float, high: float, apply: Any, start: float) -> Effect:
    height = Curve(0.0, low, high, unit, f"change of {channel} at each knot", scale=scale)
    starts = ({"height": start},) if start else ()
    return Effect(f"{channel} curve", "surface", "", "", {"height": height}, (channel,), "", (), {}, "", apply, starts)


CURVES = {
    "intensity": _curve("intensity", "nats", 0.15, -2.0, 2.0, _dim, 0.0),
    "range": _curve("range", "m", 0.03, -1.0, 1.0, _misread, 0.0),
    "drop": _curve("drop", "1", 0.1, 0.0, 0.95, _lose, 0.03),
}
"""By channel. They take a basis where effects take a scan."""


def with_basis(problem: Problem, covariate: str) -> Problem:
    """The problem with the covariate's basis (b, c, r, COLUMNS) in place of its scan."""
    rays = problem.ev.rays
    hit = np.asarray(rays.hit)
    basis = np.zeros((*hit.shape, COLUMNS), np.float32)
    basis[hit] = fixed_basis(values_of(covariate, rays, hit).astype(np.float64), covariate)
    return replace(problem, scan=jnp.asarray(basis))  # pyright: ignore[reportArgumentType]


def fixed_basis(x: np.ndarray, covariate: str) -> Float[np.ndarray, "n 36"]:
    """`curve_basis`, filled up with zeros (rows in pairs of neighbours where they are many)."""
    if covariate in CATEGORICAL:
        values, place = np.unique(x, return_inverse=True)
        return np.eye(COLUMNS, dtype=np.float32)[place * COLUMNS // max(len(values), COLUMNS)]
    found = curve_basis(x, covariate, 2 * RULES.knots)
    return np.pad(found, ((0, 0), (0, COLUMNS - found.shape[1])))
