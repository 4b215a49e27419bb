"""What a ray's disagreement may depend on: covariates, bases of curves along them, and free curves as laws.

A free curve is what an effect outside the catalogue would look like: a law like any other, whose parameters are heights
at the columns of a basis. The rays carry the basis of the covariate that it runs along; all have the same shape, so
that one compiled program serves all curves of a channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.fit import Problem
from jaxsim.discover.rules import RULES
from jaxsim.discover.verdict.names import CATEGORICAL, HUE_ANGLE, NAMED
from jaxsim.effects import Law, Parameter
from jaxsim.effects.learned import CHANGE, CHANGE_UNITS, LIMITS, OFFSET, hats, quantile_knots
from jaxsim.effects.rays import Array, Rays, covariates
from jaxsim.products import matmul

ON_HOST = covariates(np)
COVARIATES = {name: read for name, read in ON_HOST.items() if name not in ("column", HUE_ANGLE)}
"""Covariates along which residuals are looked at: functions of rays on the host, by the name that a verdict uses."""
BANKS = {"row": ("row", "even rows"), "even rows": ("row", "even rows"), "even columns": ("even columns",)}
"""What readouts are told apart by, and along what else where one of them tells: a readout may have a gain of its own,
or a black level, which adds to intensities."""
PRODUCTS = {"intensity": ("range x incidence", "range x row", "azimuth x row")}
"""Pairs of covariates along which curves of a channel are tried whatever the residuals show: what goes by both may go
by neither, and levels of surfaces, each of which is seen at one range and angle, and by few beams, take it up."""
BASIS_COLUMNS = 36
"""Columns of every free curve's basis; one that needs fewer (knots, classes) is filled up with zeros."""


@dataclass(frozen=True)
class Dependence:
    """A covariate that a channel's residuals depend on."""

    channel: str
    covariate: str
    p_value: float
    share: float
    """Share of the residuals' variance that it explains on held-out scenes."""
    gain: float
    """Held-out nats, all scenes."""
    adds: bool = False
    """Whether a free curve's heights are added to the intensity, in its unit, and are no nats of a gain."""
    steps: tuple[float, ...] = ()
    """Where a free curve along it steps, if it is level between."""

    @property
    def change(self) -> str:
        """What a free curve along it does, by a name of CURVES."""
        return OFFSET if self.adds else self.channel


def parts_of(covariate: str) -> tuple[str, ...]:
    """The covariates of which one is the product, `A x B`. (`speed x time` is a covariate of its own.)"""
    return (covariate,) if covariate in ON_HOST else tuple(covariate.split(" x "))


def spelled(covariate: str) -> str:
    """A covariate, or two that interact, in a verdict's words."""
    return " x ".join(NAMED.get(part, part) for part in parts_of(covariate))


def values_of(covariate: str, rays: Any, counts: np.ndarray) -> np.ndarray:
    """A covariate of the rays where `counts`, on the host."""
    return np.asarray(ON_HOST[covariate](_Picked(rays, counts)))


def values_along(problem: Problem, covariate: str) -> Float[np.ndarray, " n"]:
    """A covariate of all rays of a problem that hit anything."""
    rays = problem.ev.rays
    return values_of(covariate, rays, np.asarray(rays.hit)).astype(np.float64)


class _Picked:
    """The chosen rays' fields, read like a Rays."""

    def __init__(self, rays: Any, counts: np.ndarray):
        self._rays, self._counts = rays, counts

    def __getattr__(self, name: str) -> np.ndarray:
        # Of all fields of a ray only those that a covariate reads are copied.
        return np.asarray(getattr(self._rays, name))[self._counts]


def curve_basis(x: np.ndarray, name: str, most: int = RULES.knots) -> Float[np.ndarray, "n k"]:
    """Functions of a covariate that are nowhere negative and sum to 1: one column a category, hat functions between
    at most `most` quantiles, or a parabola's Bernstein polynomials where a covariate has few values (one a frame)."""
    x = np.asarray(x, np.float64)
    values = np.unique(x)
    if name in CATEGORICAL:
        return (x[:, None] == values).astype(np.float32)
    if len(values) < 2:
        return np.zeros((len(x), 0), np.float32)
    if len(values) <= RULES.few_values:
        # Mostly a value a frame: what holds on frames with other values can hardly bend.
        t = (x - values[0]) / (values[-1] - values[0])
        return np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=-1).astype(np.float32)
    knots = quantile_knots(x, most)
    if len(knots) < 2:
        return np.zeros((len(x), 0), np.float32)
    return hats(x, knots).astype(np.float32)


@dataclass(frozen=True)
class Heights(Parameter):
    """A curve's coefficients: its height at each column of a basis."""

    columns: int = BASIS_COLUMNS

    def dims(self, rows: int) -> tuple[int, ...]:
        """One number a column, whatever the sensor."""
        return (self.columns,)


def _curve(change: str, meaning: str, scale: float) -> Law:
    """A free curve of a change, within its limits. Its `apply` raises ValueError for rays that carry no basis."""

    def apply(p: dict[str, Array], rays: Rays) -> Rays:
        if rays.basis is None:
            raise ValueError("a free curve needs the basis of its covariate: make the problem with `with_basis`")
        return CHANGE[change](rays, matmul(rays.basis, p["height"]))

    return Law(
        name=f"{change} curve",
        parameters={"height": Heights(0.0, *LIMITS[change], CHANGE_UNITS[change], meaning, scale=scale)},
        channels=("intensity" if change == OFFSET else change,),
        apply=apply,
        starts=({"height": 0.03},) if change == "drop" else (),
    )


CURVES = {
    "intensity": _curve("intensity", "change of ln I at each knot", 0.15),
    OFFSET: _curve(OFFSET, "addition to I at each knot", 0.02),
    "range": _curve("range", "change of the reading at each knot", 0.03),
    "drop": _curve("drop", "share of echoes lost at each knot", 0.1),
}
"""A curve for each of the changes of laws, along the covariate whose basis the rays carry (`with_basis`)."""


def with_basis(problem: Problem, covariate: str, *, steps: tuple[float, ...] = ()) -> Problem:
    """The problem whose rays carry the covariate's basis, so that the one program of a channel serves all curves."""
    return with_columns(problem, basis_along(problem, covariate, steps=steps))


def basis_along(problem: Problem, covariate: str, *, steps: tuple[float, ...] = ()) -> Float[np.ndarray, "n k"]:
    """The basis of a curve along a covariate, or along a product of two, of all rays of a problem that hit anything;
    with `steps` one that is level between these."""
    names = parts_of(covariate)
    if len(names) > 1:
        return product_basis(problem, names, product_knots(problem, names))
    return fixed_basis(values_along(problem, covariate), covariate, steps=steps)


def product_knots(problem: Problem, names: Sequence[str]) -> list[Float[np.ndarray, " _"]]:
    """The knots of each of two covariates of which a product's curve is made."""
    return [quantile_knots(values_along(problem, name), RULES.interaction_knots) for name in names]


def product_basis(
    problem: Problem, names: Sequence[str], knots: Sequence[Float[np.ndarray, " _"]]
) -> Float[np.ndarray, "n k"]:
    """The products of two covariates' hat functions with these knots, of all rays that hit anything."""
    return products(*[hats(values_along(problem, name), at) for name, at in zip(names, knots, strict=True)])


def heights_at(
    here: Problem, there: Problem, *, along: Dependence, numbers: Float[np.ndarray, " 36"]
) -> Float[np.ndarray, " n"]:
    """The height at each ray of `here` that hits anything of a curve that was fitted to the rays of `there`."""
    names = parts_of(along.covariate)
    if len(names) > 1:
        basis = product_basis(here, names, product_knots(there, names))
        return basis @ numbers[: basis.shape[1]]
    known = values_along(there, along.covariate)
    height = fixed_basis(known, along.covariate, steps=along.steps) @ numbers
    order = np.argsort(known, kind="stable")
    return np.interp(values_along(here, along.covariate), known[order], height[order])


def with_columns(problem: Problem, columns: Float[np.ndarray, "n k"]) -> Problem:
    """The problem whose rays carry a basis, given for those that hit; at most BASIS_COLUMNS columns."""
    hit = np.asarray(problem.ev.rays.hit)
    # Filled up to the width of every free curve, so that one compiled program serves all.
    basis = np.zeros((*hit.shape, BASIS_COLUMNS), np.float32)
    basis[hit, : columns.shape[1]] = columns
    # On the device once: every step of every fit reads it.
    return replace(problem, basis=jax.device_put(basis))


def products(first: Float[np.ndarray, "n j"], second: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n jk"]:
    """Products of every column of one basis with every column of another: a curve along one for each part of the
    other."""
    return (first[:, :, None] * second[:, None, :]).reshape(len(first), -1)


def fixed_basis(x: np.ndarray, covariate: str, *, steps: tuple[float, ...] = ()) -> Float[np.ndarray, "n 36"]:
    """The `curve_basis` of a covariate with BASIS_COLUMNS columns: filled up with zeros where it has fewer;
    neighbouring rows share one where there are more. With `steps`, a column for each part between these."""
    if steps:
        return np.eye(BASIS_COLUMNS, dtype=np.float32)[np.searchsorted(steps, x, side="right")]
    if covariate in CATEGORICAL:
        values, index = np.unique(x, return_inverse=True)
        return np.eye(BASIS_COLUMNS, dtype=np.float32)[index * BASIS_COLUMNS // max(len(values), BASIS_COLUMNS)]
    basis = curve_basis(x, covariate, 2 * RULES.knots)
    return np.pad(basis, ((0, 0), (0, BASIS_COLUMNS - basis.shape[1])))
