"""Where simulation and measurement disagree: which channel's residuals depend on which covariate, given the others.

Residuals are brought to a standard normal scale by the null model (intensity and range by their own
distribution, drop by its rate), so that one tool serves the three channels: an additive model of smooth curves,
one a covariate, fitted by ridge regression and judged on held-out scenes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import rankdata

from jaxsim.discover.find.additive import Additive
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import chance_of_best

FITTED = (("intensity", "class"),)
"""Dependences that are never listed, for they are a nuisance: what is left along it says how far reflectances are held
to the table."""

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
"""Covariates of rays on the host, by the name that a verdict uses."""
ALTERNATING = ("even rows", "even columns")
"""Receivers and emitters often work in two banks, in turn."""
CATEGORICAL = ("row", "class", *ALTERNATING)
NAMED = {"step side": "step", "speed x time": "time", "hue": "rgb", "even rows": "row", "even columns": "column"}
"""What a verdict calls a covariate that is a finer look at another."""


def _step(r: Any) -> np.ndarray:
    """Signed depth step to the side where it is larger: positive to the right, compressed, m."""
    # A neighbour that hits nothing lies far behind.
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
    """Of the residuals' variance that it explains on held-out scenes."""
    gain: float
    """Held-out nats, all scenes."""


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
        t = (x - values[0]) / (values[-1] - values[0])
        return np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=-1).astype(np.float32)
    knots = np.unique(np.quantile(x, np.linspace(0, 1, most)))
    if len(knots) < 2:
        return np.zeros((len(x), 0), np.float32)
    return np.stack([np.interp(x, knots, row) for row in np.eye(len(knots))], axis=-1).astype(np.float32)


def localise(
    rays: Any,
    residuals: Mapping[str, tuple[np.ndarray, np.ndarray]],
    scene: Int[np.ndarray, " b"],
    *,
    most: int = RULES.dependences_tried,
) -> list[Place]:
    """Ranks (channel, covariate), strongest first. Within a channel a covariate counts for what it adds to
    those above it. A p-value is that of the strongest of all covariates tried (`chance_of_best`), times the channels.

    `rays` are host arrays (b, c, r); `residuals` gives each channel's standardised residuals and where they count;
    `scene` is that of each block.
    """
    places = []
    scenes = np.unique(scene)
    for channel, (z, counts) in residuals.items():
        if counts.sum() < RULES.fewest_residuals:
            continue
        index = np.searchsorted(scenes, np.broadcast_to(scene[:, None, None], counts.shape)[counts])
        designs = {name: curve_basis(values_of(name, rays, counts), name) for name in COVARIATES}
        designs = {name: design for name, design in designs.items() if design.shape[1] > 1}
        if "time" in designs and _one_clock(rays, counts):
            del designs["time"]
        model = Additive(z[counts].astype(np.float64), designs, index, scenes=len(scenes))
        squares = (model.z**2).sum()
        taken: list[str] = []
        rest = list(designs)
        before = model.predicted(taken)
        while rest and len(taken) < most:
            after = [model.predicted([*taken, name]) for name in rest]
            by_scene = [model.by_scene(before, prediction) for prediction in after]
            gains = np.stack([gain for gain, _ in by_scene])
            best = int(gains.sum(1).argmax())
            gain = float(gains[best].sum())
            if gain <= 0:
                break
            # The channels are a second list of which the best is taken: Bonferroni, for they are only three.
            p = min(1.0, len(residuals) * chance_of_best(np.stack([rate for _, rate in by_scene]), best))
            places.append(Place(channel, rest[best], p, 2 * gain / squares, gain))
            taken.append(rest.pop(best))
            before = after[best]
    return sorted(places, key=lambda place: -place.gain)


def reported(places: Iterable[Place]) -> list[Place]:
    """The places that a verdict lists, strongest first."""
    sure = [
        place
        for place in places
        if place.p_value <= RULES.dependence_level
        and place.gain >= RULES.dependence_nats
        and (place.channel, place.covariate) not in FITTED
    ]
    return sorted(sure, key=lambda place: -place.gain)[: RULES.dependences_listed]


def _one_clock(rays: Any, counts: np.ndarray) -> bool:
    """Whether the time within the scan and the azimuth are one covariate, as in a steady turn: it is called azimuth."""
    time = rankdata(values_of("time", rays, counts))
    azimuth = rankdata(values_of("azimuth", rays, counts))
    return abs(float(np.corrcoef(time, azimuth)[0, 1])) > RULES.one_clock


def values_of(covariate: str, rays: Any, counts: np.ndarray) -> np.ndarray:
    """A covariate of the rays where `counts`, on the host."""
    return np.asarray(COVARIATES[covariate](_Picked(rays, counts)))


class _Picked:
    """The chosen rays' fields, read like a Rays."""

    def __init__(self, rays: Any, counts: np.ndarray):
        self._rays, self._counts = rays, counts

    def __getattr__(self, name: str) -> np.ndarray:
        return np.asarray(getattr(self._rays, name))[self._counts]
