"""A dependence outside the catalogue: free curves along covariates, and what the best of them looks like.

Free curves (`covariates.CURVES`) compete with the effects on the same terms. Where one wins, its shape is told in words
and by a closed formula: a line, a step or a wave, if one of these comes near it.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.covariates import (
    BANKS,
    CURVES,
    PRODUCTS,
    Dependence,
    basis_along,
    fixed_basis,
    parts_of,
    spelled,
    values_along,
    with_basis,
)
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.name.candidates import THREADS, Candidate, rank_effects
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import attainable
from jaxsim.discover.verdict import Unexplained
from jaxsim.discover.verdict.names import ALTERNATING, CATEGORICAL, NAMED
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.learned import OFFSET, TURNING, quantile_knots
from jaxsim.effects.rays import TURN
from jaxsim.metrics.intervals import jackknife_half_width

X_WORDS = {
    "range": "ln of range in m",
    "power": "ln of power",
    "intensity": "ln of intensity",
    "step": "ln(1 + step / 0.3 m)",
    "frame": "s since the first frame",
}
"""What the x of a formula is, where it is not the covariate itself."""
TAKEN_UP = {"intensity": ("range", "incidence", "azimuth", "even columns", "frame", "speed", "hue angle")}
"""Covariates tried besides, along which residuals show little: levels of streets, surfaces and strips take up what
there is."""


def free_curves(
    problem: Problem, dependences: Sequence[Dependence], without: Sequence[str] = (), *, bar: float = -np.inf
) -> list[tuple[Dependence, Candidate]]:
    """Curves along the strongest covariates of each channel, and along those that levels take up, fitted and judged
    like effects; best first. Where intensities follow the readout, additions are tried beside gains. Channels `without`
    are left out; `bar` is that of `rank_effects`."""
    # They wait for these together.
    _ = problem.null_fits
    tried: list[Dependence] = []
    for channel in [name for name in CHANNELS if name not in without]:
        strongest = [dependence for dependence in dependences if dependence.channel == channel][: RULES.curves_tried]
        names = {dependence.covariate for dependence in strongest}
        untried = [Dependence(channel, name, 1.0, 0.0, 0.0) for name in TAKEN_UP.get(channel, ()) if name not in names]
        tried += [*strongest, *(dependence for dependence in untried if _varies(problem, dependence.covariate))]
        tried += [Dependence(channel, product, 1.0, 0.0, 0.0) for product in PRODUCTS.get(channel, ())]
        if channel == "intensity":
            banks = dict.fromkeys(bank for name in names for bank in BANKS.get(name, ()))
            tried += [Dependence(channel, bank, 1.0, 0.0, 0.0, adds=True) for bank in banks]
    with ThreadPoolExecutor(THREADS) as pool:
        curves = pool.map(partial(curve_along, problem, bar=bar), tried)
        return sorted(zip(tried, curves, strict=True), key=lambda pair: -pair[1].total)


def curve_along(problem: Problem, dependence: Dependence, *, bar: float = -np.inf) -> Candidate:
    """A free curve along what a channel may depend on, fitted and judged like an effect."""
    with_curve = with_basis(problem, dependence.covariate, steps=dependence.steps)
    [candidate] = rank_effects(with_curve, [CURVES[dependence.change]], null_fits=problem.null_fits, bar=bar)
    return candidate


def agreed(curve: Candidate, bar: float = RULES.bar_nats) -> bool:
    """Whether a curve passes the bar and the scenes agree on it. One that adds to intensities must also be as large as
    an offset has to be: rounding near 0 adds a little everywhere."""
    slight = curve.effect is CURVES[OFFSET] and curve.size < RULES.negligible
    return curve.accepted(bar) and sure(curve) and not slight


def sure(curve: Candidate) -> bool:
    """Whether the scenes agree on a curve; more surely than on an effect, since curves are many and bend anywhere."""
    return curve.chance <= attainable(RULES.curve_level, len(curve.by_scene), tests=2) or curve.sudden


def curve_numbers(problem: Problem, dependence: Dependence) -> int:
    """How many numbers a curve along this has: the columns of its basis that rays reach."""
    return int(basis_along(problem, dependence.covariate).any(0).sum())


def _varies(problem: Problem, covariate: str) -> bool:
    """Whether a covariate has more than two values, so that a curve along it can bend."""
    return len(np.unique(values_along(problem, covariate))) > 2


def describe_curve(problem: Problem, dependence: Dependence, candidate: Candidate) -> Unexplained:
    """The curve over its covariate, its character, and a closed formula that comes near it; of a product of two how far
    it goes."""
    if len(parts_of(dependence.covariate)) > 1:
        size = curve_numbers(problem, dependence)
        height = np.mean([np.asarray(values["height"])[:size] for values in candidate.fitted_values], axis=0)
        formula = f"{LETTER[dependence.change]} between {height.min():.3g} and {height.max():.3g}"
        return Unexplained(dependence.channel, spelled(dependence.covariate), "other", formula)
    x, grid, basis, heights = at_knots(problem, dependence, candidate)
    # The height at a knot is the mean over fits that left a fold out each; their scatter gives the band.
    curves = heights @ basis.T
    y, band = curves.mean(0), jackknife_half_width(curves)
    # A knot counts for the rays about it; the 1 keeps knots without any from being free.
    weight = np.histogram(x, bins=np.concatenate([grid, [np.inf]]))[0] + 1.0
    # A few rays far off do not make a bend of the others a wave.
    span = float(np.subtract(*np.quantile(x, [1 - RULES.outer_rays, RULES.outer_rays])))
    character, formula = shape_of(grid, y, weight, dependence=dependence, span=span)
    name = NAMED.get(dependence.covariate, dependence.covariate)
    formula += f" (x: {X_WORDS.get(dependence.covariate, dependence.covariate)})"
    return Unexplained(
        channel=dependence.channel,
        covariate=name,
        character=character,
        formula=formula,
        x=tuple(map(float, grid)),
        y=tuple(map(float, y)),
        band=tuple(map(float, band)),
        adds=dependence.adds,
        along=dependence.covariate if name != dependence.covariate else "",
    )


class CurveAtKnots(NamedTuple):
    """A free curve of m numbers, fitted with each of f folds left out, at k knots, from n values of its covariate."""

    x: Float[np.ndarray, " n"]
    """The covariate of each ray."""
    knots: Float[np.ndarray, " k"]
    basis: Float[np.ndarray, "k m"]
    """Heights at the knots are its product with the numbers."""
    numbers: Float[np.ndarray, "f m"]


def at_knots(problem: Problem, dependence: Dependence, curve: Candidate) -> CurveAtKnots:
    """A free curve that was fitted to a problem's rays, at its knots."""
    x = values_along(problem, dependence.covariate)
    knots = np.unique(x)
    if dependence.steps:
        # The ends of each level part: between two of these a law goes from one level to the next.
        parts = np.split(knots, np.searchsorted(knots, dependence.steps))
        knots = np.unique([end for part in parts for end in (part[0], part[-1])])
    elif dependence.covariate not in CATEGORICAL and len(knots) > RULES.few_values:
        knots = quantile_knots(x, 2 * RULES.knots)
    # The basis follows from the values that it is made of: rays and knots go in, the knots' rows come out.
    basis = fixed_basis(np.concatenate([x, knots]), dependence.covariate, steps=dependence.steps)[len(x) :]
    numbers = np.stack([np.asarray(values["height"]) for values in curve.fitted_values])
    return CurveAtKnots(x, knots, basis, numbers)


LETTER = {"intensity": "Δ ln I", OFFSET: "Δ I", "range": "Δ r", "drop": "p(drop)"}
"""What a curve of each change is the height of."""


@dataclass(frozen=True)
class _Shape:
    """A closed formula that a curve may come near to."""

    character: str
    formula: str
    numbers: int
    """How many numbers were chosen to fit it."""
    values: np.ndarray


def shape_of(
    x: np.ndarray, y: np.ndarray, weight: np.ndarray, *, dependence: Dependence, span: float | None = None
) -> tuple[str, str]:
    """The character of a curve y(x) and its formula: the best of a line, a step and a wave by weighted least squares,
    with a price for freedom; `other` where none comes near. Nearly all rays lie within a `span` of x, by
    default all of it."""
    if dependence.covariate == "class":
        top = np.argsort(-np.abs(y))[:3]
        return "other", ", ".join(f"{y[k]:+.3g} for class {int(x[k])}" for k in top)
    letter = LETTER[dependence.change]
    if dependence.covariate in ALTERNATING:
        return "periodic", f"{letter} ≈ {y[-1]:+.3g} on odd {dependence.covariate[5:]}, {y[0]:+.3g} on even ones"
    mean = np.average(y, weights=weight)
    whole = float((weight * (y - mean) ** 2).sum()) + 1e-12

    def unexplained(shape: _Shape) -> float:
        # Every number that shaped the formula makes what it leaves count for more.
        return float((weight * (y - shape.values) ** 2).sum()) / whole * (1 + RULES.shape_price * shape.numbers)

    closed = dependence.covariate in TURNING and float(x[-1] - x[0]) > RULES.whole_turn * TURN
    fewest, most = RULES.wave_cycles
    # A curve that closes has whole cycles; of others quarters are near enough.
    cycles = np.arange(fewest, most + 0.01, 0.25) * TURN / (span or float(x[-1] - x[0]) or 1.0)
    turns = np.arange(1.0, most + 0.5) if closed else cycles
    shapes = [_line(x, y, weight), *_steps(x, y, weight), *_waves(x, y, weight, turns=turns)]
    if dependence.steps:
        shapes = _spans(x, y, weight) if len(dependence.steps) > 1 else _steps(x, y, weight)
    best = min(shapes, key=unexplained)
    if unexplained(best) < RULES.shape_unlike:
        return best.character, f"{letter} ≈ {best.formula}"
    return "other", f"{letter} between {y.min():.3g} and {y.max():.3g}"


def _line(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> _Shape:
    line = np.polyfit(x, y, 1, w=np.sqrt(weight))
    return _Shape("monotone", f"{line[0]:.3g}·x {line[1]:+.3g}", 2, np.polyval(line, x))


def _steps(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> list[_Shape]:
    """A step at each place between two knots, but for the outermost ones."""
    shapes = []
    for cut in (x[1:] + x[:-1])[1:-1] / 2:
        low = np.average(y[x < cut], weights=weight[x < cut])
        high = np.average(y[x >= cut], weights=weight[x >= cut])
        shapes.append(_Shape("step", f"{low:.3g} below {cut:.3g}, {high:.3g} above", 3, np.where(x < cut, low, high)))
    return shapes


def _spans(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> list[_Shape]:
    """A level between two places between knots, and another before and after."""
    shapes = []
    for low, high in combinations((x[1:] + x[:-1]) / 2, 2):
        within = (x >= low) & (x < high)
        inside = np.average(y[within], weights=weight[within])
        outside = np.average(y[~within], weights=weight[~within])
        formula = f"{inside:.3g} from {low:.3g} to {high:.3g}, {outside:.3g} else"
        shapes.append(_Shape("step", formula, 4, np.where(within, inside, outside)))
    return shapes


def _waves(x: np.ndarray, y: np.ndarray, weight: np.ndarray, *, turns: Float[np.ndarray, " n"]) -> list[_Shape]:
    """A wave about a level for each of so many rad per unit of x, its size and phase by least squares."""
    shapes = []
    for w in turns:
        design = np.stack([np.ones_like(x), np.sin(w * x), np.cos(w * x)], axis=1) * np.sqrt(weight)[:, None]
        beta = np.linalg.lstsq(design, y * np.sqrt(weight), rcond=None)[0]
        size = np.hypot(beta[1], beta[2])
        phase = np.arctan2(beta[2], beta[1])
        formula = f"{beta[0]:.3g} + {size:.3g}·sin({w:.3g}·x {phase:+.3g})"
        # beta: level, sine, cosine.
        wave = beta[0] + beta[1] * np.sin(w * x) + beta[2] * np.cos(w * x)
        shapes.append(_Shape("periodic", formula, 4, wave))
    return shapes
