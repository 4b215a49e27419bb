"""Parameters of effects that were named between different streets: Gauss-Newton steps from the start that won, all
effects together.

90 % intervals are as wide as a bootstrap over the scenes of both sides has them (its standard deviation, times
Student's t for so few scenes: its percentiles would be too narrow), or as rays and prior do if that is wider, and as
far as the prior pulls: what intensities do not tell keeps the width of its prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.discover.add import interval_of
from jaxsim.discover.model.parameters import fitted_parameters, ravel, restorer, to_values, to_z
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped
from jaxsim.discover.unpaired.columns import Columns, change_of, derivatives
from jaxsim.discover.unpaired.conditional import Conditional
from jaxsim.discover.unpaired.equations import Block, Equations, equations, solve
from jaxsim.discover.unpaired.held_out import held_out_losses
from jaxsim.discover.verdict import Interval
from jaxsim.effects import Effect

NEWTON_STEPS = 12
"""Gauss-Newton steps at most."""
PARTS_OF_STEP = (1.0, 0.5, 0.25, 0.1)
"""Shares of a step, tried until the loss falls."""


@dataclass(frozen=True)
class Refined:
    """Effects with their parameters."""

    intervals: tuple[dict[str, Interval | tuple[Interval, ...]], ...]
    change: Float[np.ndarray, " n"]
    """Change of ln I by all of them, on every ray as if it were measured."""


def refine(problem: Conditional, chosen: Sequence[Columns]) -> Refined:
    """Fits the effects of the chosen columns to the find scenes, from their starts."""
    if not chosen:
        return Refined((), np.zeros(len(problem.y)))
    joint = JointFit(problem, chosen)
    linear = joint.fit()
    # The interval is symmetric in z, where effects are as good as linear, not in their own units.
    half = joint.half_widths(linear)
    low = joint.values_at(linear.z - half)
    high = joint.values_at(linear.z + half)
    intervals = []
    for effect, values, lows, highs in zip(joint.effects, joint.values, low, high, strict=True):
        ends: dict[str, Interval | tuple[Interval, ...]] = {}
        for name, p in fitted_parameters(effect).items():
            value = np.broadcast_to(values.get(name, p.neutral), p.dims(joint.rows))
            ends[name] = interval_of(value, lows[name], highs[name], unit=p.unit)
        intervals.append(ends)
    return Refined(tuple(intervals), joint.change())


@dataclass(frozen=True)
class LinearEffects:
    """Effects made linear where they stand."""

    equations: Equations
    block: Block
    z: Float[np.ndarray, " k"]


class JointFit:
    """All effects together, with law and nuisances fitted beside them. Its vector z has every fitted parameter, in the
    order of `ravel`, which is that of the effects' columns."""

    def __init__(self, problem: Conditional, chosen: Sequence[Columns]):
        self.problem = problem
        self.effects: list[Effect] = [found.effect for found in chosen if found.effect is not None]
        self.values: list[dict[str, Any]] = [dict(found.start) for found in chosen]
        self.changes = [
            change_of(effect, problem.rays, problem.comparison.rows, spread=problem.spread) for effect in self.effects
        ]
        self.rows = problem.comparison.rows

    @property
    def z(self) -> Float[np.ndarray, " k"]:
        """Where the values are."""
        return ravel(self._in_z())

    def _in_z(self) -> list[dict[str, np.ndarray]]:
        """The values of every effect as its z."""
        both = zip(self.effects, self.values, strict=True)
        return [to_z(effect, values, self.rows, dtype=np.float64) for effect, values in both]

    def values_at(self, z: Float[np.ndarray, " k"]) -> list[dict[str, Any]]:
        """The values there, within their bounds."""
        result = []
        for effect, of_z in zip(self.effects, restorer(self._in_z(), np.float64)(z), strict=True):
            values = to_values(effect, of_z)
            within = {name: np.clip(values[name], p.low, p.high) for name, p in fitted_parameters(effect).items()}
            result.append(within)
        return result

    def change(self) -> Float[np.ndarray, " n"]:
        """The change of ln I by all effects."""
        parts = [change(values) for change, values in zip(self.changes, self.values, strict=True)]
        return sum(parts, np.zeros(len(self.problem.y)))

    def derivatives(self) -> list[Columns]:
        """The derivatives of ln I by each effect's parameters, at their values."""
        row = self.problem.rays.row
        return [
            derivatives(effect, values, change, row=row, rows=self.rows)
            for effect, values, change in zip(self.effects, self.values, self.changes, strict=True)
        ]

    def linear(self) -> LinearEffects:
        """The effects at their values."""
        near = self.problem.side[:, self.problem.nuisance.columns]
        parts = self.derivatives()
        side = np.concatenate([near, *(part.columns for part in parts)], axis=1)
        block = _after(near, parts)
        return LinearEffects(equations_without(self.problem, side, self.change()), block, self.z)

    def ahead(self, linear: LinearEffects, weight: Float[np.ndarray, " s"]) -> Float[np.ndarray, " k"]:
        """Where the loss of so weighted scenes would be least if all were linear."""
        pooled = linear.equations.pooled(weight, self.problem.measured)
        # The prior pulls the parameter, not the step, to neutral.
        pooled.right[linear.block.columns] -= linear.block.precision * linear.z
        # One Newton step of a problem that is linear there: the change of z beside the nuisances.
        side = solve(pooled, [self.problem.nuisance, linear.block]).side
        return linear.z + side[len(self.problem.nuisance.columns) :]

    def loss(self, linear: LinearEffects) -> float:
        """The loss with the effects as they are, nats."""
        nuisance = self.problem.nuisance
        solution = self.problem.solved([], linear.equations)
        # Minus the log-posterior: half the residuals' squares, and the priors of nuisances and of z.
        data = linear.equations.losses(solution, self.problem.measured)[self.problem.find].sum()
        return float(data + 0.5 * nuisance.precision @ solution.side**2 + 0.5 * linear.block.precision @ linear.z**2)

    def fit(self) -> LinearEffects:
        """Gauss-Newton steps, each as long as lets the loss fall: effects are not linear in their parameters."""
        linear = self.linear()
        least = self.loss(linear)
        for _ in range(NEWTON_STEPS):
            step = self.ahead(linear, self.problem.weight) - linear.z
            before = self.values
            for share in PARTS_OF_STEP:
                self.values = [
                    old | new for old, new in zip(before, self.values_at(linear.z + share * step), strict=True)
                ]
                ahead = self.linear()
                loss = self.loss(ahead)
                if loss < least:
                    linear = ahead
                    least = loss
                    break
                # Back to where it stood, from which a shorter share is tried.
                self.values = before
            else:
                break
        return linear

    def half_widths(self, linear: LinearEffects) -> Float[np.ndarray, " k"]:
        """Half widths of the intervals of z: the scatter between scenes, or between rays if that is wider, and how far
        the prior pulls."""
        draws = [self.ahead(linear, weight) for weight in self.problem.resampled()]
        reach = RULES.interval_widening * self.problem.reach
        # To first order the prior moves z by covariance times gradient of its penalty: a bias that no scatter shows.
        pull = np.abs(self._covariance(linear, 1.0) @ (linear.block.precision * linear.z))
        of_rays = self._covariance(linear, self.problem.inflation)
        return reach * np.sqrt(np.maximum(np.var(draws, axis=0), np.diag(of_rays))) + pull

    def _covariance(self, linear: LinearEffects, information: float) -> Float[np.ndarray, "k k"]:
        """The covariance of z by rays and prior, the rays' information multiplied."""
        inner = linear.equations.pooled(self.problem.weight, self.problem.measured).inner
        nuisance = self.problem.nuisance
        columns = np.concatenate([nuisance.columns, linear.block.columns])
        precision = np.diag(np.concatenate([nuisance.precision, linear.block.precision]))
        # The nuisances are inverted too, so that what they leave open widens z.
        inverse = np.linalg.inv(information * inner[np.ix_(columns, columns)] + precision)
        return inverse[-len(linear.z) :, -len(linear.z) :]


def beside(problem: Conditional, chosen: Sequence[Columns]) -> Conditional:
    """The problem with the effects of the chosen columns fitted: what they change is off the measured readings, and
    where their parameters may still go stands among the nuisances."""
    joint = JointFit(problem, chosen)
    joint.fit()
    parts = joint.derivatives()
    side = np.concatenate([problem.side, *(part.columns for part in parts)], axis=1)
    moves = _after(problem.side, parts)
    near = problem.nuisance
    nuisance = Block(np.concatenate([near.columns, moves.columns]), np.concatenate([near.precision, moves.precision]))
    change = joint.change()
    y = problem.y - np.where(problem.comparison.measured[problem.comparison.scene], change, 0)
    return replace(problem, y=y, side=side, equations=equations_without(problem, side, change), nuisance=nuisance)


def _after(side: Float[np.ndarray, "n k"], parts: Sequence[Columns]) -> Block:
    """The parts' columns as one block after those of a side."""
    precision = np.concatenate([part.precision for part in parts])
    return Block(side.shape[1] + np.arange(len(precision)), precision)


def gain_of(problem: Conditional, refined: Refined) -> float:
    """What effects gain with parameters that were fitted to all find scenes, nats, none of which decides alone; law and
    nuisances are fitted without the scene that is judged."""
    near = problem.side[:, problem.nuisance.columns]

    def losses(change: Float[np.ndarray, " n"]) -> Float[np.ndarray, " f"]:
        return held_out_losses(replace(problem, equations=equations_without(problem, near, change)), problem.nuisance)

    return float(clipped(losses(0 * refined.change) - losses(refined.change)).sum())


def equations_without(
    problem: Conditional, side: Float[np.ndarray, "n k"], change: Float[np.ndarray, " n"]
) -> Equations:
    """The equations of the readings with `change` taken off the measured ones, in the problem's units."""
    comparison = problem.comparison
    eq = equations(
        problem.y - np.where(comparison.measured[comparison.scene], change, 0),
        problem.law,
        side,
        random=problem.random,
        scene=comparison.scene,
        scenes=len(comparison.scenes),
        variance=problem.variance,
    )
    return eq.scaled(problem.inflation)
