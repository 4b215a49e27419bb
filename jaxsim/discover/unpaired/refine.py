"""Parameters of effects that were found between different streets: Gauss-Newton steps from the start that won, all
effects together, with 90 % intervals from a bootstrap over the scenes of both sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.discover.parameters import fitted_parameters
from jaxsim.discover.unpaired.conditional import PATCH_SD, Conditional, own_columns, own_sd
from jaxsim.discover.unpaired.law import Block, Equations, equations, solve
from jaxsim.discover.unpaired.shared import Columns, at, change_of
from jaxsim.discover.verdict import Interval
from jaxsim.effects import Effect

ROUNDS = 4
DRAWS = 200


@dataclass(frozen=True)
class Refined:
    """Effects with their parameters."""

    values: tuple[dict[str, Any], ...]
    intervals: tuple[dict[str, Interval | tuple[Interval, ...]], ...]
    change: Float[np.ndarray, " n"]
    """Of ln I by all of them, on every ray as if it were measured."""


def refine(problem: Conditional, chosen: Sequence[Columns]) -> Refined:
    """Fits the effects of the chosen columns to the find scenes, from their starts."""
    if not chosen:
        return Refined((), (), np.zeros(len(problem.y)))
    effects = [one.effect for one in chosen if one.effect is not None]
    values: list[dict[str, Any]] = [dict(one.start) for one in chosen]
    changes = [change_of(e, problem.rays, problem.streets.scan, problem.spread) for e in effects]
    row, rows = problem.rays.row, len(np.asarray(problem.streets.grid.elevation_rad))

    def moved() -> np.ndarray:
        return sum((change(v) for change, v in zip(changes, values, strict=True)), np.zeros(len(row)))

    def linear() -> tuple[Equations, Block, np.ndarray]:
        parts = [at(e, v, c, row, rows) for e, v, c in zip(effects, values, changes, strict=True)]
        near = problem.side[:, problem.nuisance.columns]
        eq = equations_of(problem, np.concatenate([near, *(p.columns for p in parts)], axis=1), moved())
        precision = np.concatenate([p.precision for p in parts])
        return eq, Block(near.shape[1] + np.arange(len(precision)), precision), _z(effects, values, rows)

    sensed = problem.streets.measured.astype(float)

    def step_of(eq: Equations, block: Block, z: np.ndarray, weight: np.ndarray) -> np.ndarray:
        inner, right, _, _ = eq.pooled(weight, sensed)
        # The prior pulls the parameter, not the step, to neutral.
        right[block.columns] -= block.precision * z
        return solve(inner, right, [problem.nuisance, block])[0][len(problem.nuisance.columns) :]

    for _ in range(ROUNDS):
        eq, block, z = linear()
        _put(effects, values, z + step_of(eq, block, z, problem.find.astype(float)), rows)
    eq, block, z = linear()
    rng = np.random.default_rng(0)
    found = []
    for _ in range(DRAWS):
        weight = np.zeros(len(sensed))
        for side in (0, 1):
            places = np.flatnonzero(problem.find & (sensed == side))
            np.add.at(weight, rng.choice(places, len(places)), 1.0)
        found.append(z + step_of(eq, block, z, weight))
    low, high = np.quantile(found, [0.05, 0.95], axis=0)
    return Refined(tuple(values), tuple(_intervals(effects, values, low, high, rows)), moved())


def equations_of(problem: Conditional, side: np.ndarray, change: Float[np.ndarray, " n"]) -> Equations:
    """Of the readings with `change` taken off the measured ones, in the problem's units."""
    streets = problem.streets
    y = problem.y - np.where(streets.measured[streets.scene], change, 0)
    own = own_columns(streets, problem.kind)
    eq = equations(
        problem.law, side, own, own_sd(), PATCH_SD, y, streets.scene, problem.patch,
        scenes=len(streets.scenes), variance=problem.variance,
    )  # fmt: skip
    k = problem.inflation
    return Equations(eq.gram / k, eq.right / k, eq.square / k, eq.law)


def _z(effects: Sequence[Effect], values: Sequence[dict[str, Any]], rows: int) -> Float[np.ndarray, " k"]:
    """Every fitted parameter less its neutral value, in units of its scale, in the order of the columns."""
    parts = [
        np.broadcast_to((np.asarray(v.get(name, p.neutral), float) - p.neutral) / p.scale, p.dims(rows) or (1,))
        for e, v in zip(effects, values, strict=True)
        for name, p in fitted_parameters(e).items()
    ]
    return np.concatenate(parts)


def _put(effects: Sequence[Effect], values: list[dict[str, Any]], z: np.ndarray, rows: int) -> None:
    start = 0
    for effect, value in zip(effects, values, strict=True):
        for name, p in fitted_parameters(effect).items():
            size = int(np.prod(p.dims(rows)))
            new = np.clip(p.neutral + p.scale * z[start : start + size], p.low, p.high)
            value[name] = new if p.dims(rows) else float(new[0])
            start += size


def _intervals(
    effects: Sequence[Effect], values: Sequence[dict[str, Any]], low: np.ndarray, high: np.ndarray, rows: int
) -> list[dict[str, Any]]:
    start, result = 0, []
    for effect, value in zip(effects, values, strict=True):
        found: dict[str, Any] = {}
        for name, p in fitted_parameters(effect).items():
            size = int(np.prod(p.dims(rows)))
            ends = [np.clip(p.neutral + p.scale * x[start : start + size], p.low, p.high) for x in (low, high)]
            middle = np.atleast_1d(value[name])
            entries = [Interval(float(v), float(a), float(b), p.unit) for v, a, b in zip(middle, *ends, strict=True)]
            found[name] = tuple(entries) if p.dims(rows) else entries[0]
            start += size
        result.append(found)
    return result
