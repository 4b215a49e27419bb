"""Formulas: the grammar that the search for a closed law tries.

    y = level + size · shape        shape, of at most three nodes:  x 1,  f(x) 2,  f(g(x)) 3,  x1 · x2 3

f and g are powers (halves), exp, ln, a step and a sine; a power whose exponent is free costs a node more. Letters: n
knots (of a product all pairs), m columns, c values of a constant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.discover.rules import RULES

Constants = Float[np.ndarray, " c"]
Columns = Float[np.ndarray, "c n m"]
HALVES = tuple(k / 2 for k in range(-6, 7) if k not in (0, 2))
"""Exponents: a physical law's are seldom others."""
FREE = np.linspace(-4, 4, 33)
"""Exponents between which a free one lies."""


class Variable(NamedTuple):
    """A covariate in the unit in which its law is told."""

    name: str
    unit: str
    x: Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Shape:
    """A formula but for its numbers."""

    nodes: int
    expression: str
    """The formula in Python, of `level`, `size`, the constant's name, `phase` and the variables."""
    columns: Callable[[Constants], Columns]
    """What is linear: one column, or the sine and cosine of a wave, at each value of the constant."""
    unit: str
    """What the unit of `size` is divided by."""
    constant: str = ""
    """Name of the one number inside; empty where there is none."""
    constant_unit: str = ""
    grid: tuple[float, ...] = (0.0,)
    refined: bool = False
    """Whether the constant may lie between those of the grid."""


def shapes_of(variables: Sequence[Variable]) -> list[Shape]:
    """All formulas of the grammar."""
    shapes = [shape for one in variables if len(np.unique(one.x)) >= RULES.law_fewest_knots for shape in _of_one(one)]
    if len(variables) == 2:
        a, b = variables
        unit = " · ".join(filter(None, (a.unit, b.unit)))
        shapes.append(Shape(3, f"level + size * {a.name} * {b.name}", _alone(a.x * b.x), unit))
    return shapes


def _of_one(variable: Variable) -> list[Shape]:
    name, unit, x = variable
    values = np.unique(x)
    # A step between knots, with two of them on either side at least: one knot alone is an outlier.
    middles = tuple(((values[1:] + values[:-1]) / 2)[1:-1].tolist())
    shapes = [
        Shape(1, f"level + size * {name}", _alone(x), unit),
        Shape(2, f"level + size * ({name} >= edge)", lambda c: _one(x >= c[:, None]), "", "edge", unit, middles),
        *_bends(name, x, unit, nodes=2),
    ]
    inner = [(f"{name}**2", x**2, f"{unit}²" if unit else "")]
    if x.min() > 0:
        # Powers and logarithms are taken of x over its middle: its size stays one of y's.
        at = f"({name} / {_reference(x):.6g})"
        u = x / float(f"{_reference(x):.6g}")
        shapes.append(Shape(2, f"level + size * log{at}", _alone(np.log(u)), ""))
        power = f"level + size * {at}**exponent"
        shapes.append(Shape(2, power, lambda p: _one(u ** p[:, None]), "", "exponent", "", HALVES))
        freely = tuple(FREE.tolist())
        shapes.append(Shape(3, power, lambda p: _power(u, p), "", "exponent", "", freely, refined=True))
        shapes.append(Shape(3, f"level + size * log{at}**2", _alone(np.log(u) ** 2), ""))
        inner += [(f"log{at}", np.log(u), ""), (f"{at}**-1", 1 / u, "")]
    for text, t, of in inner:
        shapes += _bends(text, t, of, nodes=3)
    return shapes


def _bends(text: str, t: Float[np.ndarray, " n"], unit: str, *, nodes: int) -> list[Shape]:
    """An exponential and a sine of something: `text` and `unit` tell what."""
    span = float(np.ptp(t))
    # Steeper than a tenth of the span is a step, flatter than twice it a line.
    scales = span * np.geomspace(0.1, 2.0, 14)
    both = tuple(sorted([*(-scales).tolist(), *scales.tolist()]))
    # With less than a cycle it is a bend, with more the knots do not follow it.
    most = max(min(8.0, len(np.unique(t)) / 2.5), 1.01)
    periods = tuple((span / np.arange(1.0, most, 0.2)).tolist())
    # From its larger end on, so that no size is astronomical.
    begin = {True: float(f"{t.max():.6g}"), False: float(f"{t.min():.6g}")}
    shapes = []
    for grows, grid in ((True, both[len(scales) :]), (False, both[: len(scales)])):
        start = begin[grows]
        shapes.append(
            Shape(
                nodes,
                f"level + size * exp(({text} - {start:.6g}) / scale)".replace("- -", "+ "),
                lambda s, start=start: _one(np.exp((t - start) / s[:, None])),
                "",
                "scale",
                unit,
                grid,
                refined=True,
            )
        )
    wave = f"level + size * sin(2 * pi * {text} / period + phase)"

    def waves(period: Constants) -> Columns:
        angle = 2 * np.pi * t / period[:, None]
        return np.stack([np.sin(angle), np.cos(angle)], axis=-1)

    return [*shapes, Shape(nodes, wave, waves, "", "period", unit, periods, refined=True)]


def _alone(x: Float[np.ndarray, " n"]) -> Callable[[Constants], Columns]:
    """One column, whatever the constant."""
    return lambda c: np.repeat(x[None, :, None], len(c), axis=0)


def _one(x: np.ndarray) -> Columns:
    """One column for each constant."""
    return x[..., None].astype(np.float64)


def _power(u: Float[np.ndarray, " n"], p: Constants) -> Columns:
    """The power, kept away from exponent 0, where it is a level."""
    return _one(u ** np.where(np.abs(p) > 0.05, p, 0.05)[:, None])


def _reference(x: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(x.min() * x.max()))
