"""Parameters of effects that were found between different streets: Gauss-Newton steps from the start that won, all
effects together.

90 % intervals are as wide as a bootstrap over the scenes of both sides has them, or as rays and prior do if that is
wider, and as far as the prior pulls: what intensities do not tell keeps the width of its prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.parameters import fitted_parameters
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import student_reach
from jaxsim.discover.unpaired.conditional import PATCH_SD, Conditional, own_columns, own_sd
from jaxsim.discover.unpaired.law import Block, Equations, equations, solve
from jaxsim.discover.unpaired.shared import Columns, at, change_of
from jaxsim.discover.verdict import Interval
from jaxsim.effects import Effect

ROUNDS = 12
SHARES = (1.0, 0.5, 0.25, 0.1)
"""Of a step, tried until the loss falls."""
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
    joint = _Joint(problem, chosen)
    here = joint.fit()
    half = joint.half_widths(here)
    found = _intervals(joint.effects, joint.values, here.z - half, here.z + half, joint.rows)
    return Refined(tuple(joint.values), tuple(found), joint.change())


@dataclass(frozen=True)
class _Here:
    """Effects made linear where they stand."""

    eq: Equations
    block: Block
    z: Float[np.ndarray, " k"]


class _Joint:
    """All effects together, with law and nuisances fitted beside them."""

    def __init__(self, problem: Conditional, chosen: Sequence[Columns]):
        self.problem, self.sensed = problem, problem.streets.measured.astype(float)
        self.everyone = problem.find.astype(float)
        self.effects = [one.effect for one in chosen if one.effect is not None]
        self.values: list[dict[str, Any]] = [dict(one.start) for one in chosen]
        self.changes = [change_of(e, problem.rays, problem.streets.scan, problem.spread) for e in self.effects]
        self.rows = len(np.asarray(problem.streets.grid.elevation_rad))

    def change(self) -> Float[np.ndarray, " n"]:
        each = (change(v) for change, v in zip(self.changes, self.values, strict=True))
        return sum(each, np.zeros(len(self.problem.y)))

    def linear(self) -> _Here:
        row, near = self.problem.rays.row, self.problem.side[:, self.problem.nuisance.columns]
        each = zip(self.effects, self.values, self.changes, strict=True)
        parts = [at(effect, values, change, row, self.rows) for effect, values, change in each]
        eq = equations_of(self.problem, np.concatenate([near, *(p.columns for p in parts)], axis=1), self.change())
        precision = np.concatenate([p.precision for p in parts])
        block = Block(near.shape[1] + np.arange(len(precision)), precision)
        return _Here(eq, block, _z(self.effects, self.values, self.rows))

    def ahead(self, here: _Here, weight: Float[np.ndarray, " s"]) -> Float[np.ndarray, " k"]:
        """Where the loss would be least if all were linear."""
        inner, right, _, _ = here.eq.pooled(weight, self.sensed)
        # The prior pulls the parameter, not the step, to neutral.
        right[here.block.columns] -= here.block.precision * here.z
        found, _, _ = solve(inner, right, [self.problem.nuisance, here.block])
        return here.z + found[len(self.problem.nuisance.columns) :]

    def loss(self, here: _Here) -> float:
        """With the effects as they are, nats."""
        nuisance, find = self.problem.nuisance, self.problem.find
        inner, right, cross, base = here.eq.pooled(self.everyone, self.sensed)
        side, columns, _ = solve(inner, right, [nuisance])
        left = here.eq.losses(base - cross[:, columns] @ side, side, columns, self.sensed)[find].sum()
        return float(left + 0.5 * nuisance.precision @ side**2 + 0.5 * here.block.precision @ here.z**2)

    def fit(self) -> _Here:
        """Gauss-Newton steps, each as long as lets the loss fall: effects are not linear in their parameters."""
        here = self.linear()
        least = self.loss(here)
        for _ in range(ROUNDS):
            step, before = self.ahead(here, self.everyone) - here.z, [dict(values) for values in self.values]
            for share in SHARES:
                _put(self.effects, self.values, here.z + share * step, self.rows)
                there = self.linear()
                if (now := self.loss(there)) < least:
                    here, least = there, now
                    break
                self.values = [dict(values) for values in before]
            else:
                break
        return here

    def half_widths(self, here: _Here) -> Float[np.ndarray, " k"]:
        """Of the intervals of z: the scatter between scenes, or between rays if that is wider, and how far the prior
        pulls."""
        rng, found = np.random.default_rng(0), []
        sides = [np.flatnonzero(self.problem.find & (self.sensed == side)) for side in (0, 1)]
        for _ in range(DRAWS):
            drawn = np.concatenate([rng.choice(places, len(places)) for places in sides])
            found.append(self.ahead(here, np.bincount(drawn, minlength=len(self.sensed)).astype(float)))
        inner, nuisance = here.eq.pooled(self.everyone, self.sensed)[0], self.problem.nuisance
        columns = np.concatenate([nuisance.columns, here.block.columns])
        held = np.diag(np.concatenate([nuisance.precision, here.block.precision]))
        each = (np.linalg.inv(k * inner[np.ix_(columns, columns)] + held) for k in (1.0, self.problem.inflation))
        ours, of_rays = (inverse[-len(here.z) :, -len(here.z) :] for inverse in each)
        fewest = min(len(places) for places in sides)
        reach = RULES.interval_widening * np.sqrt(fewest / (fewest - 1)) * student_reach(fewest)
        pull = np.abs(ours @ (here.block.precision * here.z))
        return reach * np.sqrt(np.maximum(np.var(found, axis=0), np.diag(of_rays))) + pull


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
