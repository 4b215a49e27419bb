"""Where simulation and measurement disagree: which channel's residuals depend on which covariate, given the others.

Residuals are brought to a standard normal scale by the null model (intensity and range by their own
distribution, drop by its rate), so that one tool serves the three channels: an additive model of smooth curves,
one a covariate, fitted by ridge regression and judged on held-out units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import rankdata

KNOTS = 10
FEW = 40
"""Different values of a covariate up to which a curve of it is a parabola: it must hold on frames that it has not seen.
"""
RIDGE = 4.0
"""Observations' worth of pull of a curve's knots to 0."""
FLIPS = 4096
"""Of signs over units, to see what chance does."""

COVARIATES: dict[str, Callable[[Any], np.ndarray]] = {
    "range": lambda r: np.log(np.maximum(r.range_m, 0.5)),
    "incidence": lambda r: r.incidence_rad,
    "row": lambda r: r.row,
    "azimuth": lambda r: r.azimuth_rad,
    "even rows": lambda r: r.row % 2,
    "even columns": lambda r: r.column % 2,
    "class": lambda r: r.semantic,
    "power": lambda r: r.log_power,
    "intensity": lambda r: r.log_intensity,
    "step": lambda r: np.abs(_step(r)),
    "step side": lambda r: _step(r),
    "frame": lambda r: r.time_s,
    "time": lambda r: r.phase,
    "speed": lambda r: r.speed_mps,
    "speed x time": lambda r: r.speed_mps * (r.phase - 0.5) * np.cos(r.azimuth_rad),
    "heading": lambda r: np.mod(r.azimuth_rad + r.heading_rad, 2 * np.pi),
    "rgb": lambda r: r.rgb.mean(-1),
    "hue": lambda r: r.rgb[..., 0] - r.rgb[..., 2],
}
"""Of rays on the host, by the name that a verdict uses."""
ALTERNATING = ("even rows", "even columns")
"""Receivers and emitters often work in two banks, in turn."""
CATEGORICAL = ("row", "class", *ALTERNATING)
NAMED = {"step side": "step", "speed x time": "time", "hue": "rgb", "even rows": "row", "even columns": "column"}
"""What a verdict calls a covariate that is a finer look at another."""


def _step(r: Any) -> np.ndarray:
    """Signed depth step to the side where it is larger: positive to the right, compressed, m."""
    side = [np.where(np.isfinite(r.beside_m[..., k]), r.beside_m[..., k], 100.0) - r.range_m for k in (0, 1)]
    step = np.where(np.abs(side[0]) > np.abs(side[1]), -side[0], side[1])
    return np.sign(step) * np.log1p(np.abs(step) / 0.3)


@dataclass(frozen=True)
class Place:
    """A covariate that a channel's residuals depend on."""

    channel: str
    covariate: str
    p_value: float
    share: float
    """Of the residuals' variance that it explains on held-out units."""
    gain: float
    """Held-out nats, all units."""


def curve_basis(x: np.ndarray, name: str, most: int = KNOTS) -> Float[np.ndarray, "n k"]:
    """Functions of a covariate that are nowhere negative and sum to 1: one column a category, hat functions between
    at most `most` quantiles, or a parabola's Bernstein polynomials where a covariate has few values (one a frame)."""
    x = np.asarray(x, np.float64)
    values = np.unique(x)
    if name in CATEGORICAL:
        return (x[:, None] == values).astype(np.float32)
    if len(values) < 2:
        return np.zeros((len(x), 0), np.float32)
    if len(values) <= FEW:
        t = (x - values[0]) / (values[-1] - values[0])
        return np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=-1).astype(np.float32)
    knots = np.unique(np.quantile(x, np.linspace(0, 1, most)))
    if len(knots) < 2:
        return np.zeros((len(x), 0), np.float32)
    return np.stack([np.interp(x, knots, row) for row in np.eye(len(knots))], axis=-1).astype(np.float32)


def _gains(
    z: np.ndarray, designs: list[np.ndarray], unit: Int[np.ndarray, " n"], units: np.ndarray, group: np.ndarray
) -> Float[np.ndarray, " u"]:
    """Held-out gain in nats of each unit by the additive model over `designs`."""
    x = np.concatenate(designs, axis=1)
    gains = np.zeros(len(units))
    place = np.searchsorted(units, unit)
    for fold in np.unique(group):
        train = group[place] != fold
        a = x[train]
        beta = np.linalg.solve(a.T @ a + RIDGE * np.eye(x.shape[1]), a.T @ z[train])
        held = ~train
        gain = 0.5 * (z[held] ** 2 - (z[held] - x[held] @ beta) ** 2)
        gains += np.bincount(place[held], gain, len(units))
    return gains


def p_value(gains: Float[np.ndarray, " u"]) -> float:
    """One-sided probability of so large a mean gain if units gain nothing: exact sign-flip test up to 12 units,
    else by FLIPS draws."""
    if not gains.any():
        return 1.0
    return float(np.mean(signs_of(len(gains)) @ gains >= gains.sum() - 1e-12))


def localise(
    rays: Any, residuals: dict[str, tuple[np.ndarray, np.ndarray]], unit: Int[np.ndarray, " b"], *, most: int = 4
) -> list[Place]:
    """Ranks (channel, covariate), strongest first. Within a channel a covariate counts for what it adds to
    those above it. A p-value is that of the strongest of all covariates tried (`chance_of_best`), times the channels.

    `rays` are host arrays (b, c, r); `residuals` gives each channel's standardised residuals and where they count.
    """
    places = []
    units = np.unique(unit)
    group = np.arange(len(units)) % min(4, len(units))
    for channel, (z, counts) in residuals.items():
        of_unit = np.broadcast_to(unit[:, None, None], counts.shape)[counts]
        values = z[counts].astype(np.float64)
        if len(values) < 100:
            continue
        designs = {name: curve_basis(values_of(name, rays, counts), name) for name in COVARIATES}
        designs = {name: d for name, d in designs.items() if d.shape[1] > 1}
        if "time" in designs and _one_clock(rays, counts):
            del designs["time"]
        taken: list[np.ndarray] = [np.ones((len(values), 1), np.float32)]
        before = _gains(values, taken, of_unit, units, group)
        for _ in range(most):
            gains = {name: _gains(values, [*taken, d], of_unit, units, group) - before for name, d in designs.items()}
            if not gains:
                break
            best = max(gains, key=lambda name: gains[name].sum())
            gain = gains[best]
            if gain.sum() <= 0:
                break
            p = min(1.0, len(residuals) * chance_of_best(np.stack(list(gains.values())), list(gains).index(best)))
            places.append(Place(channel, best, p, float(2 * gain.sum() / (values**2).sum()), float(gain.sum())))
            taken.append(designs.pop(best))
            before = before + gain
    return sorted(places, key=lambda place: -place.gain)


def chance_of_best(gains: Float[np.ndarray, "p u"], best: int) -> float:
    """How often chance makes some row of units' gains as large in all as row `best` is: trying many is paid for
    (Westfall & Young 1993, by signs over units; rows that say nothing lose, which errs to the safe side)."""
    by_chance = (signs_of(gains.shape[1]) @ gains.T).max(1)
    return float(np.mean(by_chance >= gains[best].sum() - 1e-12))


def signs_of(n: int) -> Float[np.ndarray, "k n"]:
    """All ways to give n units signs, up to 12 units; else FLIPS at random, the first all positive."""
    if n <= 12:
        return 1.0 - 2 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (FLIPS, n))
    signs[0] = 1
    return signs


def _one_clock(rays: Any, counts: np.ndarray) -> bool:
    """Whether the time within the scan and the azimuth are one covariate, as in a steady turn: it is called azimuth."""
    time, azimuth = (rankdata(values_of(name, rays, counts)) for name in ("time", "azimuth"))
    return abs(float(np.corrcoef(time, azimuth)[0, 1])) > 0.99


def values_of(covariate: str, rays: Any, counts: np.ndarray) -> np.ndarray:
    """A covariate of the rays where `counts`, on the host."""
    return np.asarray(COVARIATES[covariate](_Picked(rays, counts)))


class _Picked:
    """The chosen rays' fields, read like a Rays."""

    def __init__(self, rays: Any, counts: np.ndarray):
        self._rays, self._counts = rays, counts

    def __getattr__(self, name: str) -> np.ndarray:
        return np.asarray(getattr(self._rays, name))[self._counts]
