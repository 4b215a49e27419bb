"""Law: a closed formula for a learned curve or product, by a small symbolic search over its knots.

    y = level + size · shape        shape, of at most three nodes:  x 1,  f(x) 2,  f(g(x)) 3,  x1 · x2 3

f and g are powers (halves), exp, ln, a step and a sine; a power whose exponent is free costs a node more. Letters: n
knots (of a product all pairs), g groups of scenes, t curves, m columns, c values of a constant.

Every formula is fitted to the knots by least squares, weighted by their sd: level and size in closed form, the one
constant inside the shape on a grid and then by golden section. It is chosen by what it gains over a level alone on
groups of scenes that its fit has not seen, less `Rules.law_price_nats` a node. What group i says is its jackknife
pseudo-value, g·(all) - (g-1)·(all but i) (Tukey 1958; Efron & Tibshirani 1993, ch. 11), whose variance is g·sd². Knots
that hang on fewer fitted numbers count as so many.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.discover.law.learn import LearnedFit
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import jackknife_sd
from jaxsim.discover.verdict import ClosedLaw, Interval
from jaxsim.discover.verdict.names import ALTERNATING
from jaxsim.effects.learned import CHANGE_UNITS
from jaxsim.metrics.intervals import student_reach

Constants = Float[np.ndarray, " c"]
_Columns = Float[np.ndarray, "c n m"]
HALVES = tuple(k / 2 for k in range(-6, 7) if k not in (0, 2))
"""Exponents: a physical law's are seldom others."""
EXPONENTS = np.linspace(-4, 4, 33)
"""Exponents of which the best is where the search for a free one begins, a quarter apart."""
_Curves = Float[np.ndarray, "t n"]
LEAST_EXPONENT = 0.05
"""Exponents nearer to 0 are taken as this: at 0 a power is a level."""
KNOTS_A_CYCLE = 2.5
"""Knots of a curve that a cycle of a wave needs: two would follow any phase ..."""
LEAST_CYCLES = 1.01
"""... but one whole cycle is always tried."""
WAVE_NUMBERS = 4
"""A wave's level, size, phase and period: a curve of fewer numbers is followed by one whatever it is."""
GOLDEN = (np.sqrt(5) - 1) / 2
"""Share of its bracket that a section keeps."""
SECTIONS = 24
"""Steps of a golden-section search: the bracket shrinks to 1e-5 of itself."""
VARIABLES = {
    "range": ("range_m", "m"),
    "incidence": ("incidence_rad", "rad"),
    "height": ("height_m", "m"),
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
    columns: Callable[[Constants], _Columns]
    """What is linear: one column, or the sine and cosine of a wave, at each value of the constant."""
    unit: str
    """What the unit of `size` is divided by."""
    constant: str = ""
    """Name of the one number inside; empty where there is none."""
    constant_unit: str = ""
    grid: tuple[float, ...] = (0.0,)
    refined: bool = False
    """Whether the constant may lie between those of the grid."""


def formula_shapes(variables: Sequence[Variable]) -> list[Shape]:
    """All formulas of the grammar."""
    wide = [variable for variable in variables if len(np.unique(variable.x)) >= RULES.law_fewest_knots]
    shapes = [shape for variable in wide for shape in _of_one(variable)]
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
        freely = tuple(EXPONENTS.tolist())
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
    # With less than a cycle it is a bend, with more the knots do not follow it.
    most = max(min(RULES.wave_cycles[1], len(np.unique(t)) / KNOTS_A_CYCLE), LEAST_CYCLES)
    periods = tuple((span / np.arange(1.0, most, 0.2)).tolist())
    shapes = []
    for end, grid in ((t.max(), scales), (t.min(), -scales[::-1])):
        # From its larger end on, so that no size is astronomical.
        start = float(f"{end:.6g}")
        expression = f"level + size * exp(({text} - {start:.6g}) / scale)".replace("- -", "+ ")
        columns = lambda s, start=start: _one(np.exp((t - start) / s[:, None]))  # noqa: E731
        shapes.append(Shape(nodes, expression, columns, "", "scale", unit, tuple(grid.tolist()), refined=True))
    wave = f"level + size * sin(2 * pi * {text} / period + phase)"

    def waves(period: Constants) -> _Columns:
        angle = 2 * np.pi * t / period[:, None]
        return np.stack([np.sin(angle), np.cos(angle)], axis=-1)

    return [*shapes, Shape(nodes, wave, waves, "", "period", unit, periods, refined=True)]


def _alone(x: Float[np.ndarray, " n"]) -> Callable[[Constants], _Columns]:
    """One column, whatever the constant."""
    return lambda c: np.repeat(x[None, :, None], len(c), axis=0)


def _one(x: np.ndarray) -> _Columns:
    """One column for each constant."""
    return x[..., None].astype(np.float64)


def _power(u: Float[np.ndarray, " n"], p: Constants) -> _Columns:
    """The power, kept away from exponent 0, where it is a level."""
    return _one(u ** np.where(np.abs(p) > LEAST_EXPONENT, p, LEAST_EXPONENT)[:, None])


def _reference(x: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(x.min() * x.max()))


class ShapeFits(NamedTuple):
    """A shape fitted to t curves."""

    constant: Float[np.ndarray, " t"]
    linear: Float[np.ndarray, "t m"]
    """The level, then a number a column."""
    values: _Curves


def search(
    variables: Sequence[Variable],
    curve: Float[np.ndarray, " n"],
    without: Float[np.ndarray, "g n"],
    *,
    channel: str,
    unit: str,
    free: int,
) -> ClosedLaw | None:
    """The formula of a curve over one variable or two, its `unit` that of `channel`; None where no formula is worth its
    nodes on groups of scenes that it has not seen, or tells less than `Rules.law_least_share` of the curve.

    `without` are the curves with a group of scenes left out each, `free` how many numbers the curve was fitted by.
    """
    groups, n = without.shape
    spread = jackknife_sd(without)
    # Of few groups a knot's own sd is uncertain, and at a bound it is 0: half of it is that of the others.
    variance = (spread**2 + np.median(spread**2)) / 2 + (1e-4 * (np.ptp(curve) + 1e-9)) ** 2
    root = 1 / np.sqrt(variance)
    # Every formula is fitted to the curve and to each curve without a group, all in one go.
    curves = np.concatenate([curve[None], without])
    # Pseudo-values: what each group alone says of the curve.
    gain = groups * curve - (groups - 1) * without
    # Knots that hang together say no more than the numbers behind them.
    count = min(free / n, 1.0)

    def loss(values: _Curves) -> float:
        return count * float((((gain - values[1:]) * root) ** 2).sum()) / (2 * groups)

    loss_of_level = loss(np.broadcast_to(np.average(curves, axis=1, weights=root**2)[:, None], curves.shape))
    best: tuple[float, Shape, ShapeFits] | None = None
    for shape in formula_shapes(variables):
        if "sin(" in shape.expression and free < WAVE_NUMBERS:
            continue
        fits = fit_shape(shape, curves, root)
        # A price a node, as of a description's length: a longer formula must say more.
        worth = loss_of_level - loss(fits.values) - RULES.law_price_nats * shape.nodes
        if best is None or worth > best[0]:
            best = worth, shape, fits
    if best is None or best[0] <= 0:
        return None
    worth, shape, fits = best
    weight = root**2
    mean = np.average(curve, weights=weight)
    unexplained = float((weight * (curve - fits.values[0]) ** 2).sum() / (weight * (curve - mean) ** 2).sum())
    if 1 - unexplained < RULES.law_least_share:
        return None
    parameters = formula_parameters(shape, fits, unit=unit)
    return ClosedLaw(
        channel=channel,
        covariates=tuple(variable.name for variable in variables if variable.name in shape.expression),
        formula=formula_text(shape, parameters),
        expression=shape.expression,
        parameters=parameters,
        limits={variable.name: (float(variable.x.min()), float(variable.x.max())) for variable in variables},
        nodes=shape.nodes,
        held_out_nats=worth + RULES.law_price_nats * shape.nodes,
        share=1 - unexplained,
    )


def fit_shape(shape: Shape, curves: _Curves, root: Float[np.ndarray, " n"]) -> ShapeFits:
    """Weighted least squares (`root` of the weights) of every curve by itself."""
    grid = np.asarray(shape.grid, float)
    y = curves * root
    # The part of each curve that the columns reach, by the grid's constants.
    reached = np.einsum("tn,cnm->ctm", y, _orthogonal(shape.columns(grid), root))
    pick = (reached**2).sum(-1).argmax(0)
    constant = grid[pick]
    # A constant that lies between two of the grid is sought within one step to both sides.
    if shape.refined:
        constant = _golden(shape, y, root, a=grid[np.maximum(pick - 1, 0)], b=grid[np.minimum(pick + 1, len(grid) - 1)])
    design = _with_level(shape.columns(constant))
    linear = np.stack([
        np.linalg.lstsq(columns * root[:, None], curve, rcond=None)[0] for columns, curve in zip(design, y, strict=True)
    ])  # fmt: skip
    return ShapeFits(constant, linear, np.einsum("tnm,tm->tn", design, linear))


def _golden(shape: Shape, y: _Curves, root: Float[np.ndarray, " n"], *, a: Constants, b: Constants) -> Constants:
    """The constant between a and b at which the columns reach most of each weighted curve."""

    def at(constant: Constants) -> Constants:
        return (np.einsum("tn,tnm->tm", y, _orthogonal(shape.columns(constant), root)) ** 2).sum(-1)

    for _ in range(SECTIONS):
        c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
        lower = at(c) >= at(d)
        a, b = np.where(lower, a, c), np.where(lower, d, b)
    return (a + b) / 2


def _orthogonal(columns: _Columns, root: Float[np.ndarray, " n"]) -> Float[np.ndarray, "c n m+1"]:
    """Orthonormal columns that span the level and the weighted columns."""
    return np.linalg.qr(_with_level(columns) * root[:, None])[0]


def _with_level(columns: _Columns) -> Float[np.ndarray, "c n m+1"]:
    return np.concatenate([np.ones((*columns.shape[:2], 1)), columns], axis=-1)


def formula_parameters(shape: Shape, fits: ShapeFits, *, unit: str) -> dict[str, Interval]:
    """The numbers of the first curve's formula with their units, and 90 % intervals from the others, each of which
    leaves out a group of scenes."""
    below = f"({shape.unit})" if re.search("[/·]", shape.unit) else shape.unit
    of_size = f"{unit or 1}/{below}" if below else unit
    if fits.linear.shape[1] == 3:
        size = np.hypot(fits.linear[:, 1], fits.linear[:, 2])
        # Sine and cosine are linear and free of one another; people read a size and a phase.
        phase = np.arctan2(fits.linear[:, 2], fits.linear[:, 1])
        # Near one another, not on two sides of the turn's end.
        phase = phase[0] + np.angle(np.exp(1j * (phase - phase[0])))
        numbers = {"size": (size, of_size), "phase": (phase, "rad")}
    else:
        numbers = {"size": (fits.linear[:, 1], of_size)}
    numbers = {"level": (fits.linear[:, 0], unit), **numbers}
    if shape.constant:
        numbers[shape.constant] = (fits.constant, shape.constant_unit)
    reach = float(student_reach(len(fits.constant) - 1))
    result = {}
    for name, (each, of) in numbers.items():
        result[name] = Interval.about(float(each[0]), reach * float(jackknife_sd(each[1:, None])[0]), of)
    return result


def formula_text(shape: Shape, parameters: dict[str, Interval]) -> str:
    """The formula with its numbers."""
    words = [
        f"{parameters[word].value:.3g}" if word in parameters else word
        for word in shape.expression.replace("(", " ( ").replace(")", " ) ").replace("**", " ^ ").split()
    ]
    text = " ".join(words).replace("( ", "(").replace(" )", ")").replace(" ^ ", "^").replace(" * ", "·")
    for function in ("exp", "log", "sin"):
        text = text.replace(f"{function} (", f"{function}(")
    return text.replace("pi", "π").replace(">=", "≥").replace("log", "ln").replace("+ -", "- ")


def closed_law(fit: LearnedFit) -> ClosedLaw | None:
    """The formula of a learned law; None where none is near, or a covariate has no order; and of what is added to
    intensities, which is told a readout at a time."""
    learned = fit.learned
    if learned.adds or not all(name in VARIABLES and name not in ALTERNATING for name in learned.covariates):
        return None
    # In the order of the law's values: the last covariate runs fastest.
    grids = np.meshgrid(*(np.asarray(knots) for knots in learned.knots), indexing="ij")
    variables = [
        Variable(*VARIABLES[name], np.exp(grid.ravel()) if name in LOGARITHMS else grid.ravel())
        for name, grid in zip(learned.covariates, grids, strict=True)
    ]
    law = search(
        variables,
        np.asarray(learned.values),
        fit.without,
        channel=learned.channel,
        unit=CHANGE_UNITS[learned.channel],
        free=fit.free,
    )
    if law is None:
        return None
    by_variable = {VARIABLES[name][0]: name for name in learned.covariates}
    return replace(law, covariates=tuple(by_variable[name] for name in law.covariates))
