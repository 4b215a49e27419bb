"""The comparison of ln I given what both range images say: the law, what may differ anyway, and the candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.unpaired.law import RIDGE, Block, Equations, each, equations, freedom, hats, lowered, one_hot
from jaxsim.discover.unpaired.shared import OF_CLASSES, OF_INTENSITY, Columns, change_of, columns_of
from jaxsim.discover.unpaired.streets import Streets
from jaxsim.effects import EFFECTS, Effect
from jaxsim.effects.rays import REFERENCE_M, Rays

CLIP = 3.0
"""Robust standard deviations about each side's own law at which readings are held."""
PATCH_M, PATCH_SD = 4.0, 0.25
"""Surfaces have a level of their own over so much, nats."""
OWN_SD = (0.3, 0.2, 0.3, 0.1)
"""Of a scene's level, and of its slopes over ln r, incidence (rad) and height (m), for each kind of surface."""
CLASS_SD = 0.3
"""Of a class's reflectance about the simulator's, nats."""
CURVATURE_SD = 0.003
"""Of 0.5 sec(incidence)**2, which noise on normals leaves."""
CURVE_SD = 0.15
"""Of a free curve's knots, nats."""
KNOTS = 10
COMMON = 0.01
"""Classes of a smaller share of the simulated rays have no level of their own."""
QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True)
class Candidate:
    """Something that the measured side may have: an effect of the catalogue, one start of it, or a free curve."""

    name: str
    effect: Effect | None
    columns: Columns
    block: Block


@dataclass(frozen=True)
class Conditional:
    """All scenes of both sides as normal equations, and what gives them meaning."""

    streets: Streets
    y: Float[np.ndarray, " n"]
    law: Float[np.ndarray, "n l"]
    side: Float[np.ndarray, "n k"]
    kind: Int[np.ndarray, " n"]
    patch: Int[np.ndarray, " n"]
    equations: Equations
    nuisance: Block
    candidates: tuple[Candidate, ...]
    curves: tuple[Candidate, ...]
    rays: Rays
    """Intensities are the law's."""
    spread: Float[np.ndarray, " q"]
    find: Bool[np.ndarray, " s"]
    variance: float
    inflation: float
    """By how much more the losses of exchanged scenes scatter than independent noise would have them."""


def compare(streets: Streets, find: Bool[np.ndarray, " s"], draws: Float[np.ndarray, "d s"]) -> Conditional:
    """The comparison with everything that is learned (law, clipping, class mixture) from the `find` scenes."""
    rays, learn = streets.rays, find[streets.scene]
    sensed = streets.measured[streets.scene]
    kind = kinds(streets)
    law = law_columns(streets, kind)
    y = _clipped(streets.log_intensity, law, learn, sensed)
    patch = patches(streets, kind)
    own = own_columns(streets, kind)
    variance = _within(y - law @ _ridge(law[learn], y[learn]), patch, learn)

    def scenes_of(side: np.ndarray) -> Equations:
        return equations(
            law, side, own, own_sd(), PATCH_SD, y, streets.scene, patch, scenes=len(streets.scenes), variance=variance
        )

    # How much of each class, and what intensity, the simulated side has at given covariates.
    simulated = learn & ~sensed
    values, counts = np.unique(_classes(streets)[simulated], return_counts=True)
    values = values[counts > COMMON * counts.sum()]
    mixture = one_hot(_classes(streets), values)
    known = scenes_of(np.concatenate([mixture, y[:, None]], axis=1))
    weight, n = (find & ~streets.measured).astype(float), law.shape[1]
    inner = np.einsum("s,spq->pq", weight, known.gram[:, :n, :n]) + RIDGE * np.eye(n)
    coefficients = np.linalg.solve(inner, np.einsum("s,spq->pq", weight, known.gram[:, :n, n:]))
    expected = law @ coefficients
    predicted = expected[:, -1]
    spread = np.quantile((y - predicted)[simulated], QUANTILES)
    spread = spread - spread.mean()
    as_predicted = replace(
        rays,
        log_intensity=predicted.astype(np.float32),
        met_log_intensity=predicted.astype(np.float32),
        log_power=(predicted - 2 * np.log(np.maximum(rays.range_m, 0.1) / REFERENCE_M)).astype(np.float32),
    )

    # What may differ without any effect: overall gain, and reflectances of classes, known where both sides know them.
    of_classes = mixture if streets.shared_classes else expected[:, :-1]
    bend = 0.5 / np.cos(rays.incidence_rad)[:, None] ** 2
    nuisance = np.concatenate([np.ones((len(y), 1)), of_classes, bend], axis=1).astype(np.float32)
    held = np.array([1e-4, *[1 / CLASS_SD**2] * len(values), 1 / CURVATURE_SD**2])
    parts: list[np.ndarray] = [nuisance]
    names = (*OF_INTENSITY, *(OF_CLASSES if streets.shared_classes else ()))
    rows = len(np.asarray(streets.grid.elevation_rad))
    candidates, start = [], nuisance.shape[1]
    for name in names:
        effect = EFFECTS[name]
        change = change_of(effect, as_predicted, streets.scan, spread)
        for columns in columns_of(effect, change, rays.row, rows):
            candidates.append(_candidate(name, effect, columns, start))
            parts.append(columns.columns)
            start += columns.columns.shape[1]
    curves = []
    for name, basis in curve_columns(streets).items():
        columns = Columns(None, {}, basis, np.full(basis.shape[1], 1 / CURVE_SD**2))
        curves.append(_candidate(name, None, columns, start))
        parts.append(basis)
        start += basis.shape[1]
    side = np.concatenate(parts, axis=1)
    found = scenes_of(side)
    block = Block(np.arange(nuisance.shape[1]), held)
    inflation = _inflation(found, find, draws, block, [c.block for c in (*candidates, *curves)])
    found = Equations(found.gram / inflation, found.right / inflation, found.square / inflation, found.law)
    return Conditional(
        streets, y, law, side, kind, patch, found, block, tuple(candidates), tuple(curves), as_predicted, spread, find,
        variance, inflation,
    )  # fmt: skip


def _candidate(name: str, effect: Effect | None, columns: Columns, start: int) -> Candidate:
    place = np.arange(start, start + columns.columns.shape[1])
    return Candidate(name, effect, columns, Block(place, columns.precision, columns.sign))


def kinds(streets: Streets) -> Int[np.ndarray, " n"]:
    """0 ground, 1 upright, 2 other, by height and normal."""
    ground = (streets.rise > 0.7) & (streets.height_m < 0.4)
    return np.where(ground, 0, np.where(streets.rise < 0.5, 1, 2))


def _classes(streets: Streets) -> np.ndarray:
    return np.zeros(len(streets.scene), np.int32) if streets.semantic is None else streets.semantic


def law_columns(streets: Streets, kind: np.ndarray) -> Float[np.ndarray, "n l"]:
    """Additive curves over all covariates, those over range, incidence and height for each kind of surface."""
    r = streets.rays
    surfaces = one_hot(kind, np.arange(3))
    height = np.clip(streets.height_m, -1.0, 8.0)
    parts = [
        one_hot(r.row),
        each(surfaces, hats(np.log(r.range_m), 10)),
        each(surfaces, hats(r.incidence_rad, 8)),
        each(surfaces, hats(height, 8)),
        hats(np.log(streets.bend + 1e-4), 6),
        hats(r.azimuth_rad, 9),
    ]
    if streets.shared_classes:
        parts.append(one_hot(_classes(streets)))
    return np.concatenate(parts, axis=1)


def own_sd() -> Float[np.ndarray, " o"]:
    """Of the columns of `own_columns`."""
    return np.repeat(OWN_SD, 3)


def own_columns(streets: Streets, kind: np.ndarray) -> Float[np.ndarray, "n o"]:
    """What is a scene's own: a level, and slopes over ln r, incidence and height, of each kind of surface."""
    surfaces = one_hot(kind, np.arange(3))
    slopes = [np.log(streets.rays.range_m), streets.rays.incidence_rad, np.clip(streets.height_m, -1.0, 8.0)]
    return np.concatenate([surfaces, *(surfaces * (x - x.mean())[:, None] for x in slopes)], axis=1)


def patches(streets: Streets, kind: np.ndarray) -> Int[np.ndarray, " n"]:
    """Number of the cell of ground, and kind of surface, that each ray meets."""
    r = streets.rays
    flat = r.range_m * np.cos(r.elevation_rad)
    cells = [np.floor(flat * turn(r.azimuth_rad) / PATCH_M) for turn in (np.cos, np.sin)]
    key = np.stack([streets.scene, kind, *cells], axis=1).astype(np.int64)
    return np.unique(key, axis=0, return_inverse=True)[1].ravel()


def curve_columns(streets: Streets) -> dict[str, np.ndarray]:
    """Free curves of the measured side along the covariates that both sides have."""
    r = streets.rays
    curves = {
        "range": hats(np.log(r.range_m), KNOTS),
        "incidence": hats(r.incidence_rad, KNOTS),
        "azimuth": hats(r.azimuth_rad, KNOTS),
        "row": one_hot(r.row, np.arange(len(np.asarray(streets.grid.elevation_rad)))),
    }
    return {**curves, "class": one_hot(_classes(streets))} if streets.shared_classes else curves


def _ridge(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    x = x.astype(np.float64)
    return np.linalg.solve(x.T @ x + RIDGE * np.eye(x.shape[1]), x.T @ y)


def _clipped(y: np.ndarray, law: np.ndarray, learn: np.ndarray, sensed: np.ndarray) -> Float[np.ndarray, " n"]:
    """Readings held within CLIP of their side's own law."""
    y = y.copy()
    for side in (sensed, ~sensed):
        for _ in range(2):
            middle = law[side] @ _ridge(law[side & learn], y[side & learn])
            off = y[side] - middle
            reach = CLIP * 1.4826 * np.median(np.abs(off[learn[side]]))
            y[side] = middle + np.clip(off, -reach, reach)
    return y


def _within(off: np.ndarray, patch: np.ndarray, learn: np.ndarray) -> float:
    """Variance of readings about their patch's mean."""
    _, number, count = np.unique(patch[learn], return_inverse=True, return_counts=True)
    mean = np.bincount(number, off[learn]) / count
    left = (off[learn] - mean[number]) ** 2
    return float(left.sum() / max((count - 1).sum(), 1))


def _inflation(
    found: Equations, find: np.ndarray, draws: np.ndarray, nuisance: Block, blocks: Sequence[Block]
) -> float:
    """Median over candidates of what exchanged sides lower the loss by, over what independent noise would give."""
    weight = find.astype(float)
    chance = lowered(found, weight, draws[1 : 1 + 40], nuisance, blocks).mean(0)
    free = np.array([freedom(found, weight, draws[0], block) for block in blocks])
    use = free > 0.5
    return float(max(np.median(2 * chance[use] / free[use]), 1.0))
