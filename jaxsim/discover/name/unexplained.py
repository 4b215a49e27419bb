"""A dependence outside the catalogue: free curves along covariates, and what the best of them looks like."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from jaxsim.discover.find.localise import ALTERNATING, CATEGORICAL, NAMED, Place, values_of
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.name.candidates import THREADS, Candidate, rank_effects
from jaxsim.discover.name.curves import CURVES, fixed_basis, with_basis
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import fold_half_width
from jaxsim.discover.verdict import Unexplained

READ = {
    "range": "ln of range in m",
    "power": "ln of power",
    "intensity": "ln of intensity",
    "step": "ln(1 + step / 0.3 m)",
}
"""What the x of a formula is, where it is not the covariate itself."""
TAKEN_UP = {"intensity": ("azimuth", "even columns", "frame", "speed")}
"""Covariates tried besides, along which residuals show little: levels of streets and strips take up what there is."""


def free_curves(problem: Problem, places: Sequence[Place]) -> list[tuple[Place, Candidate]]:
    """Curves along the strongest covariates of each channel, and along those that levels take up, fitted and judged
    like effects; best first."""
    null = problem.null_fits

    def one(place: Place) -> tuple[Place, Candidate]:
        [candidate] = rank_effects(with_basis(problem, place.covariate), [CURVES[place.channel]], null=null)
        return place, candidate

    tried: list[Place] = []
    for channel in CURVES:
        strongest = [place for place in places if place.channel == channel][: RULES.curves_tried]
        names = {place.covariate for place in strongest}
        more = [Place(channel, name, 1.0, 0.0, 0.0) for name in TAKEN_UP.get(channel, ()) if name not in names]
        tried += [*strongest, *(place for place in more if _varies(problem, place.covariate))]
    with ThreadPoolExecutor(THREADS) as pool:
        return sorted(pool.map(one, tried), key=lambda pair: -pair[1].total)


def agreed(curve: Candidate, bar: float = RULES.bar_nats) -> bool:
    """Whether a curve passes the bar and the units agree on it."""
    return curve.accepted(bar) and sure(curve)


def sure(curve: Candidate) -> bool:
    """Whether the units agree on a curve; more surely than on an effect, since curves are many and bend anywhere."""
    least = 2 * 2.0 ** -len(curve.by_scene)
    return curve.chance <= max(RULES.curve_level, 1.01 * least) or curve.sudden


def _varies(problem: Problem, covariate: str) -> bool:
    rays = problem.ev.rays
    return len(np.unique(values_of(covariate, rays, np.asarray(rays.hit)))) > 2


def describe(problem: Problem, place: Place, candidate: Candidate) -> Unexplained:
    """The curve over its covariate, its character, and a closed formula that comes near it."""
    rays = problem.ev.rays
    hit = np.asarray(rays.hit)
    x = values_of(place.covariate, rays, hit).astype(np.float64)
    heights = np.stack([np.asarray(to_values(candidate.effect, fit.z)["height"]) for fit in candidate.fits])
    grid = _grid(x, place.covariate)
    basis = fixed_basis(np.concatenate([x, grid]), place.covariate)[len(x) :]
    curves = heights @ basis.T
    y, band = curves.mean(0), fold_half_width(curves)
    weight = np.histogram(x, bins=np.concatenate([grid, [np.inf]]))[0] + 1.0
    character, formula = shape_of(grid, y, weight, place)
    name = NAMED.get(place.covariate, place.covariate)
    formula += f" (x: {READ.get(place.covariate, place.covariate)})"
    return Unexplained(place.channel, name, character, formula, *(tuple(map(float, v)) for v in (grid, y, band)))


def _grid(x: np.ndarray, covariate: str) -> np.ndarray:
    """Where a curve is written down."""
    values = np.unique(x)
    few = covariate in CATEGORICAL or len(values) <= RULES.few_values
    return values if few else np.unique(np.quantile(x, np.linspace(0, 1, 2 * RULES.knots)))


def shape_of(x: np.ndarray, y: np.ndarray, weight: np.ndarray, place: Place) -> tuple[str, str]:
    """Best of a line, a step and a wave by weighted least squares, with a price for freedom."""
    if place.covariate == "class":
        top = np.argsort(-np.abs(y))[:3]
        return "other", ", ".join(f"{y[k]:+.3g} for class {int(x[k])}" for k in top)
    letter = {"intensity": "Δ ln I", "range": "Δ r", "drop": "p(drop)"}[place.channel]
    if place.covariate in ALTERNATING:
        return "periodic", f"{letter} ≈ {y[-1]:+.3g} on odd {place.covariate[5:]}, {y[0]:+.3g} on even ones"
    span = float(x[-1] - x[0]) or 1.0
    mean = np.average(y, weights=weight)
    whole = float((weight * (y - mean) ** 2).sum()) + 1e-12
    tried = []
    line = np.polyfit(x, y, 1, w=np.sqrt(weight))
    tried.append(("monotone", f"{letter} ≈ {line[0]:.3g}·x {line[1]:+.3g}", 2, np.polyval(line, x)))
    for cut in (x[1:] + x[:-1])[1:-1] / 2:
        low, high = (np.average(y[side], weights=weight[side]) for side in (x < cut, x >= cut))
        tried.append(
            ("step", f"{letter} ≈ {low:.3g} below {cut:.3g}, {high:.3g} above", 3, np.where(x < cut, low, high))
        )
    for cycles in np.arange(1.5, 8.01, 0.25):
        w = 2 * np.pi * cycles / span
        design = np.stack([np.ones_like(x), np.sin(w * x), np.cos(w * x)], axis=1) * np.sqrt(weight)[:, None]
        beta = np.linalg.lstsq(design, y * np.sqrt(weight), rcond=None)[0]
        size, phase = np.hypot(beta[1], beta[2]), np.arctan2(beta[2], beta[1])
        wave = beta[0] + beta[1] * np.sin(w * x) + beta[2] * np.cos(w * x)
        tried.append(("periodic", f"{letter} ≈ {beta[0]:.3g} + {size:.3g}·sin({w:.3g}·x {phase:+.3g})", 4, wave))
    name, formula, left = min(
        (
            (name, text, float((weight * (y - fit) ** 2).sum()) / whole * (1 + 0.1 * cost))
            for name, text, cost, fit in tried
        ),
        key=lambda one: one[2],
    )
    return (name, formula) if left < 0.6 else ("other", f"{letter} between {y.min():.3g} and {y.max():.3g}")
