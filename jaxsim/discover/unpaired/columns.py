"""Columns of the law, of what is a scene's own, of free curves, and of effects: those of the catalogue that act through
covariates which two sets of streets share, and what they change in ln I.

An effect is applied to rays whose geometry is that of the range image and whose intensity is what the law gives,
spread as the simulator's readings are spread about it; the mean change of ln I is the effect's column. One that can
be learned from neutral gives its derivative there (one column a beam for parameters of beams); one that cannot gives
a column for each of its starts, of which the best counts.

Letters as in equations.py; c columns of an effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.find.covariates import products
from jaxsim.discover.model.parameters import LOOSE, fitted_parameters
from jaxsim.discover.rules import RULES
from jaxsim.discover.unpaired.read import UnpairedComparison
from jaxsim.effects import EFFECTS, Effect
from jaxsim.effects.learned import hats, quantile_knots
from jaxsim.effects.rays import Array, Rays

OF_INTENSITY = (
    "incidence_cosine",
    "oren_nayar",
    "range_falloff",
    "atmospheric_extinction",
    "near_range_overlap",
    "window_contamination",
    "focal_compensation",
    "beam_gain",
)
"""Functions of range, incidence, row and azimuth."""
OF_CLASSES = ("specular_lobe", "retroreflection", "gamma_response", "intensity_offset", "saturation")
"""These show in single classes, or in the contrast between them, and need the classes of both sides."""
INCIDENCE_SET = ("incidence_cosine", "oren_nayar", "gamma_response", "intensity_offset")
"""Where classes are not known, the contrast of angles is all that these show: they are told as a set."""
OF_LOSS = ("random_dropout", "sector_occlusion", "packet_loss")
"""Functions of row and azimuth alone: a ray that is lost has no range."""
OF_READINGS = ("intensity_quantization", "range_quantization")
"""Read off the values themselves."""
DERIVATIVE_STEP = 0.25
"""Part of a parameter's scale over which derivatives are taken."""
FREE_PRECISION = 1e-4
"""Precision of the overall gain, and of the size of a start's column: next to free."""
HEIGHTS_M = (-1.0, 8.0)
"""Heights over the ground between which the law depends on them."""
GROUND = 0
"""Kind of a level surface near the ground's height, ..."""
UPRIGHT = 1
"""... of a steep one, ..."""
OTHER = 2
"""... and of all else."""
KINDS = (GROUND, UPRIGHT, OTHER)
GROUND_PATCH_M = 4.0
"""Size of the cells of ground over which surfaces have a level of their own."""


def untold(*, classes: bool) -> tuple[str, ...]:
    """Effects that cannot be told where the streets differ; `classes`: whether both sides know them."""
    tellable = {*OF_INTENSITY, *OF_LOSS, *OF_READINGS, *(OF_CLASSES if classes else ())}
    return tuple(name for name in EFFECTS if name not in tellable)


@dataclass(frozen=True)
class Columns:
    """An effect, or one start of it, as columns of the measured side."""

    effect: Effect | None
    """None of a free curve."""
    start: dict[str, Any]
    """Values of the parameters at which the columns were taken; empty for neutral."""
    columns: Float[np.ndarray, "n c"]
    precision: Float[np.ndarray, " c"]
    """Precision of the coefficients' prior about 0."""
    sign: int = 0
    """The sign that the first coefficient must have; 0: any."""


_Change = Callable[[dict[str, Any]], Float[np.ndarray, " n"]]
"""The map from values of an effect's parameters to the change of ln I that they make on every ray."""


def change_of(effect: Effect, rays: Rays, rows: int, *, spread: Float[np.ndarray, " q"]) -> _Change:
    """The function from values of the parameters (in their units, others neutral) to the mean change of ln I of every
    ray of a sensor with so many beams, over readings that lie `spread` nats about the rays' own."""
    on_device = jax.device_put(rays)

    @jax.jit
    def mean(values: dict[str, Any]) -> Array:
        total = jnp.zeros_like(on_device.range_m)
        # The mean over readings that stand for the spread: what an effect changes depends on the reading.
        for off in spread:
            moved = replace(on_device, log_intensity=on_device.log_intensity + off, log_power=on_device.log_power + off)
            total = total + effect.apply(values, moved).log_intensity - moved.log_intensity
        return total / len(spread)

    return lambda given: jax.device_get(mean(effect.values(given, rows))).astype("f8")


def columns_of(effect: Effect, change: _Change, row: Int[np.ndarray, " n"], *, rows: int) -> list[Columns]:
    """The effect's columns at neutral, or at each of its starts: the change that the start makes, whose size is free,
    and beside it the derivatives in the parameters of beams."""
    if not effect.starts:
        return [derivatives(effect, {}, change, row=row, rows=rows)]
    result = []
    for start in effect.starts:
        of_rows = [name for name, p in fitted_parameters(effect).items() if p.shape == "row"]
        of_beams = derivatives(effect, start, change, row=row, rows=rows, names=of_rows)
        columns = np.concatenate([change(start)[:, None].astype(np.float32), of_beams.columns], axis=1)
        result.append(Columns(effect, start, columns, np.concatenate([[FREE_PRECISION], of_beams.precision]), 1))
    return result


def derivatives(
    effect: Effect,
    values: dict[str, Any],
    change: _Change,
    *,
    row: Int[np.ndarray, " n"],
    rows: int,
    names: list[str] | None = None,
) -> Columns:
    """Derivatives in the named parameters (all that are fitted) at `values`, per scale of each, in the order of
    `model.parameters.ravel`; one column a beam for those of beams, held to neutral by their prior."""
    parts = [np.zeros((len(row), 0), np.float32)]
    precision = [np.zeros(0)]
    unchanged = change(values)
    for name, p in sorted(fitted_parameters(effect).items()):
        if names is not None and name not in names:
            continue
        now = np.asarray(values.get(name, p.neutral), float)
        # One-sided, and towards the inside at the upper bound: beyond a bound an effect need not make sense.
        step = DERIVATIVE_STEP * p.scale * np.where(now + DERIVATIVE_STEP * p.scale > p.high, -1, 1)
        # Per typical size of the parameter, so that one prior serves them all.
        slope = (change({**values, name: now + step}) - unchanged) / (step[row] if step.ndim else step) * p.scale
        if p.shape == "row":
            parts.append((slope[:, None] * (row[:, None] == np.arange(rows))).astype(np.float32))
            precision.append(np.ones(rows))
        else:
            parts.append(slope[:, None].astype(np.float32))
            precision.append(np.full(1, 1 / LOOSE**2))
    return Columns(effect, values, np.concatenate(parts, axis=1), np.concatenate(precision))


def curve(x: np.ndarray, count: int, *, low: float = 0.01, high: float = 0.99) -> Float[np.ndarray, "n k"]:
    """Hat functions between quantiles of x; one column of ones where x does not vary."""
    knots = quantile_knots(x, count, low=low, high=high)
    if len(knots) < 2:
        return np.ones((len(x), 1), np.float32)
    return hats(x, knots).astype(np.float32)


def one_hot(x: np.ndarray, values: np.ndarray | None = None) -> Float[np.ndarray, "n k"]:
    """A column for each value, 1 where x has it; by default for each that x has."""
    return (x[:, None] == (np.unique(x) if values is None else values)).astype(np.float32)


def kinds(comparison: UnpairedComparison) -> Int[np.ndarray, " n"]:
    """The kind of surface that each ray meets, by height and normal."""
    # rise: vertical part of the normal, 1 on level ground and 0 on walls.
    ground = (comparison.rise > RULES.unpaired_ground_rise) & (comparison.height_m < RULES.unpaired_ground_m)
    return np.where(ground, GROUND, np.where(comparison.rise < RULES.unpaired_upright_rise, UPRIGHT, OTHER))


def ray_classes(comparison: UnpairedComparison) -> np.ndarray:
    """The class of each ray; 0 for all where classes are not known."""
    return np.zeros(len(comparison.scene), np.int32) if comparison.semantic is None else comparison.semantic


def law_columns(comparison: UnpairedComparison, kind: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n l"]:
    """Additive curves over all covariates, those over range, incidence and height for each kind of surface."""
    r = comparison.rays
    surfaces = one_hot(kind, np.array(KINDS))
    height = np.clip(comparison.height_m, *HEIGHTS_M)
    parts = [
        one_hot(r.row),
        products(surfaces, curve(np.log(r.range_m), 10)),
        products(surfaces, curve(r.incidence_rad, 8)),
        products(surfaces, curve(height, 8)),
        # How far the surface bends stands for what it is: foliage bends, walls do not.
        curve(np.log(comparison.bend + 1e-4), 6),
        curve(r.azimuth_rad, 9),
    ]
    if comparison.shared_classes:
        parts.append(one_hot(ray_classes(comparison)))
    return np.concatenate(parts, axis=1)


def scene_columns(comparison: UnpairedComparison, kind: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n o"]:
    """What is a scene's own: a level, and slopes over ln r, incidence and height, of each kind of surface; their
    order is that of SCENE_SD."""
    surfaces = one_hot(kind, np.array(KINDS))
    # Centred, so that a slope leaves the level alone.
    slopes = [np.log(comparison.rays.range_m), comparison.rays.incidence_rad, np.clip(comparison.height_m, *HEIGHTS_M)]
    return np.concatenate([surfaces, *(surfaces * (x - x.mean())[:, None] for x in slopes)], axis=1)


def patches(comparison: UnpairedComparison, kind: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Number of the cell of ground, and kind of surface, that each ray meets."""
    r = comparison.rays
    # Cells lie on the ground's plane around the sensor of each scene: frames of one scene share them.
    level_m = r.range_m * np.cos(r.elevation_rad)
    cells = [np.floor(level_m * turn(r.azimuth_rad) / GROUND_PATCH_M) for turn in (np.cos, np.sin)]
    key = np.stack([comparison.scene, kind, *cells], axis=1).astype(np.int64)
    return np.unique(key, axis=0, return_inverse=True)[1].ravel()


def curve_columns(comparison: UnpairedComparison) -> dict[str, Float[np.ndarray, "n k"]]:
    """Free curves of the measured side along the covariates that both sides have."""
    r = comparison.rays
    curves = {
        "range": curve(np.log(r.range_m), RULES.knots),
        "incidence": curve(r.incidence_rad, RULES.knots),
        "azimuth": curve(r.azimuth_rad, RULES.knots),
        "row": one_hot(r.row, np.arange(comparison.rows)),
    }
    return {**curves, "class": one_hot(ray_classes(comparison))} if comparison.shared_classes else curves
