"""Noise and lattices of frames, told from their own readings.

Levels of noise come from differences between neighbouring rays of one surface. Second differences along a row, over
sqrt 6, have the variance of independent noise and no slope; of ranges those of q = 1 / range are taken, which is linear
on planes, and of intensities those over the cosine of the given incidence where they follow it. Texture and edges fill
the upper end of their distribution, so a low quantile tells the noise. The step of a lattice comes from the gaps
between values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import nnls

from jaxsim.discover.model.cast import STEEPEST_COSINE
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import FLOOR, LEAST_M, Scan
from jaxsim.frame import Array
from jaxsim.geometry import spans_turn

FINEST: dict[str, float] = dict.fromkeys(("intensity_quantization", "range_quantization"), RULES.finest_step)
"""Effects whose step is read off the values, and the finest step that counts as rounding."""
QUANTILE = 0.25
"""The quantile of absolute second differences from which noise is told: texture and edges fill the upper ones."""
NORMAL_QUANTILE = 0.31864
"""The same quantile of |N(0, 1)|."""
BINS = 12
"""Bins of intensity, over which noise is told apart into a constant and a proportional part."""
MOST_VALUES = 200_000
"""Readings, evenly chosen, in which a lattice, or a table of few values, is looked for."""


def lattice_step(values: Float[np.ndarray, " n"], *, finest: float) -> float:
    """The largest step of which nearly all values are multiples; 0 if there is none above `finest`."""
    x = np.sort(np.asarray(values, np.float64))
    if len(x) < RULES.lattice_values:
        return 0.0
    first = np.flatnonzero(np.diff(x, prepend=-np.inf) > finest / 4)
    count = np.diff(first, append=len(x))
    # The rarest values may be faulty readings: few of them lie between as few values as a lattice has.
    rarest = np.argsort(count, kind="stable")
    faulty = rarest[np.cumsum(count[rarest]) <= (1 - RULES.lattice_share) * len(x)]
    gaps = np.diff(x[np.delete(first, faulty)])
    if len(gaps) < RULES.lattice_gaps:
        return 0.0
    # On a lattice the commonest gaps between different values are one step, or few.
    smallest = np.quantile(gaps, 0.05)
    for step in (smallest, *np.unique(gaps.round(6))[:5]):
        step = _refined(x, float(step))
        if step > finest and np.mean(_on(x, step)) >= RULES.lattice_share:
            return step
    return 0.0


def _refined(x: np.ndarray, step: float) -> float:
    """Least squares of sorted values on their multiples, from coarse values to all."""
    # From small multiples on: a step that is a little off would count large values to the wrong one.
    for reach in (20, 200, 2000, 20000):
        few = x[np.searchsorted(x, step / 4) : np.searchsorted(x, (reach + 1) * step)]
        k = np.round(few / step)
        counts = slice(np.searchsorted(k, 0, "right"), np.searchsorted(k, reach, "right"))
        if k[counts].any():
            step = float((few[counts] @ k[counts]) / (k[counts] @ k[counts]))
    return step


def _on(x: np.ndarray, step: float) -> Bool[np.ndarray, "*n"]:
    """Whether each value lies on the lattice."""
    off = np.abs(x / step - np.round(x / step))
    # Values kept as float32 carry their own rounding.
    return off < RULES.lattice_near + 1e-6 * x / step


def log_rounding(values: Float[np.ndarray, "*n"], step: float, *, finest: float) -> Float[np.ndarray, "*n"]:
    """Nats by which each reading is more probable if nearly all lie on the lattice of `step` than if they are
    known to `finest`: many where it lies there, and fewer than none where it does not."""
    x = np.asarray(values, np.float64)
    return np.where(_on(x, step), np.log(RULES.lattice_share * step / finest), np.log(1 - RULES.lattice_share))


@dataclass(frozen=True)
class Levels:
    """Noise of frames, the simulator's or the sensor's, each level 0 where it is too small to matter."""

    range_m: float = 0.0
    """Standard deviation of the range."""
    intensity: float = 0.0
    """Noise of the intensity, the part that is the same for all; 0..1 scale."""
    intensity_share: float = 0.0
    """Noise of the intensity, the part in proportion to it."""
    incidence_rad: float = 0.0
    """Noise of the simulator's angles of incidence."""
    loss: float = 0.0
    """Probability that a ray within a smooth surface is lost."""
    intensity_step: float = 0.0
    """Lattice of the intensities; 0 for none."""
    range_step_m: float = 0.0

    follows_cosine: bool = False
    """Intensities follow the cosine of the given incidence, its noise too."""

    @property
    def of_intensity(self) -> bool:
        """Whether intensities are noisy."""
        return self.intensity > 0 or self.intensity_share > 0

    def variance(self, intensity: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Squared standard deviation at these intensities over the intensity."""
        return self.intensity_share**2 + (self.intensity / np.maximum(intensity, FLOOR)) ** 2

    def constant_part(self, intensity: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Share of the variance that is the same for all intensities."""
        return 1 - self.intensity_share**2 / np.maximum(self.variance(intensity), 1e-12)


def noise_levels(scan: Scan) -> Levels:
    """The levels of noise of frames, from differences between rays of one surface along a row."""
    inner, hole = neighbourhoods(scan)
    inner, hole = np.asarray(inner), np.asarray(hole)
    steps = lattices_of(scan)
    if inner.sum() < RULES.fewest_differences:
        return steps
    range_sd = sd_of(np.abs(range_bends(scan))[inner])
    slant_sd = sd_of(np.abs(second_difference(np.asarray(scan.incidence_rad, np.float64)))[inner])
    loss = hole.sum() / max(hole.sum() + inner.sum(), 1)
    constant, share, follows_cosine = _intensity_noise(scan, inner)
    levels = Levels(
        range_m=range_sd if range_sd > RULES.noisy_range_m else 0.0,
        incidence_rad=slant_sd if slant_sd > RULES.noisy_incidence_rad else 0.0,
        intensity=constant,
        intensity_share=share,
        follows_cosine=follows_cosine,
        loss=float(loss) if loss > RULES.noisy_loss else 0.0,
    )
    return on_lattices(levels, steps)


def lattices_of(scan: Scan) -> Levels:
    """The lattices of readings alone."""
    hit = np.flatnonzero(np.asarray(scan.hit))
    hit = hit[:: max(1, len(hit) // MOST_VALUES)]
    intensity, range_m = np.asarray(scan.intensity).ravel()[hit], np.asarray(scan.range_m).ravel()[hit]
    return Levels(
        intensity_step=lattice_step(intensity, finest=FINEST["intensity_quantization"]),
        range_step_m=lattice_step(range_m, finest=FINEST["range_quantization"]),
    )


def on_lattices(levels: Levels, lattices: Levels) -> Levels:
    """Levels with the lattices of others."""
    return replace(levels, intensity_step=lattices.intensity_step, range_step_m=lattices.range_step_m)


def second_difference(x: Float[np.ndarray, "f r c"]) -> Float[np.ndarray, "f r c"]:
    """The second difference of each ray and its neighbours along the row, over sqrt 6; at the borders it wraps."""
    return (np.roll(x, 1, 2) - 2 * x + np.roll(x, -1, 2)) / np.sqrt(6)


def range_bends(scan: Scan) -> Float[np.ndarray, "f r c"]:
    """Second differences of ranges along the row, m, 0 on planes."""
    range_m = np.asarray(scan.range_m, np.float64)
    # An error e of the range is one of e / range^2 of 1 / range.
    return second_difference(1 / np.maximum(range_m, LEAST_M)) * range_m**2


def sd_of(size: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of normal noise of which these are absolute values, others among them that are larger."""
    return float(np.quantile(size, QUANTILE) / NORMAL_QUANTILE)


def _intensity_noise(scan: Scan, inner: Bool[np.ndarray, "f r c"]) -> tuple[float, float, bool]:
    """The constant part of the noise on intensities, and the part in proportion to them, both 0 where they are small;
    and whether intensities follow the cosine of the given incidence."""
    intensity = np.asarray(scan.intensity, np.float64)
    bright = inner & (np.roll(intensity, 1, 2) > FLOOR) & (np.roll(intensity, -1, 2) > FLOOR) & (intensity > FLOOR)
    if bright.sum() < RULES.fewest_differences:
        return 0.0, 0.0, False
    variances = []
    # Intensities that follow the simulator's own normals follow their noise too; that is no noise on the intensity.
    for given in (np.ones_like(intensity), cosine_of(scan)):
        size = np.abs(second_difference(intensity / given)) * given
        level = (np.roll(intensity, 1, 2) + intensity + np.roll(intensity, -1, 2)) / 3
        variances.append(_by_level(size[bright], level[bright]))
    # In doubt it does: over the cosine, intensities bend less along a surface.
    follows_cosine = bool(np.mean(variances[1][1]) < RULES.cosine_as_well * np.mean(variances[0][1]))
    level, variance = variances[follows_cosine]
    # Weighted by the relative error: a line through variance / level^2 = share^2 + constant^2 / level^2.
    design = np.stack([np.ones_like(level), 1 / level**2], 1) * (level**2 / variance.clip(1e-12))[:, None]
    (share, constant), _ = nnls(design, np.ones_like(level))
    if np.median(np.sqrt(variance) / level) < RULES.noisy_intensity:
        return 0.0, 0.0, False
    if constant < RULES.noisy_constant * share * level[0] ** 2:
        return 0.0, float(np.sqrt(np.median(variance / level**2))), follows_cosine
    return float(np.sqrt(constant)), float(np.sqrt(share)), follows_cosine


def _by_level(
    size: Float[np.ndarray, " n"], level: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Median level of each bin of it, and the variance of the noise there."""
    order = np.argsort(level)
    bins = np.array_split(order, max(1, min(BINS, len(order) // RULES.fewest_differences)))
    return np.array([np.median(level[b]) for b in bins]), np.array([sd_of(size[b]) ** 2 for b in bins])


def cosine_of(scan: Scan) -> Float[np.ndarray, "f r c"]:
    """The cosine of incidence, at least STEEPEST_COSINE."""
    return np.maximum(np.cos(np.asarray(scan.incidence_rad, np.float64)), STEEPEST_COSINE)


@jax.jit
def neighbourhoods(scan: Scan) -> tuple[Bool[Array, "f r c"], Bool[Array, "f r c"]]:
    """Rays whose neighbours to both sides go on with their surface; and rays that hit nothing between two such."""
    left, right = columns_shifted(scan, 1), columns_shifted(scan, -1)
    # A surface goes on where class, instance and both neighbours' distances agree.
    alike = left.hit & right.hit & (left.semantic == right.semantic) & (left.instance == right.instance)
    q_left, q_right = 1 / jnp.maximum(left.range_m, LEAST_M), 1 / jnp.maximum(right.range_m, LEAST_M)
    middle = (q_left + q_right) / 2
    alike = alike & (jnp.abs(q_left - q_right) < RULES.same_surface_bend * middle)
    surface = scan.hit & (scan.semantic == left.semantic) & (scan.instance == left.instance)
    surface = surface & (jnp.abs(1 / jnp.maximum(scan.range_m, LEAST_M) - middle) < RULES.edge_bend * middle)
    return alike & surface, alike & ~scan.hit


def columns_shifted(scan: Scan, shift: int) -> Scan:
    """The scan turned by some columns; what comes in past a border hits nothing."""
    column = jnp.arange(scan.range_m.shape[2])
    inside = (column - shift >= 0) & (column - shift < len(column))
    inside = inside | spans_turn(scan.grid)
    turned = {
        name: jnp.roll(getattr(scan, name), shift, axis=2)
        for name in ("range_m", "hit", "intensity", "incidence_rad", "semantic", "instance", "rgb")
    }
    return replace(scan, **(turned | {"hit": turned["hit"] & inside[None, None]}))


@jax.jit
def filled(scan: Scan) -> Scan:
    """The scan with single rays put back that it lost within a surface: between their two neighbours."""
    _, hole = neighbourhoods(scan)
    left, right = columns_shifted(scan, 1), columns_shifted(scan, -1)
    between = 2 / (1 / jnp.maximum(left.range_m, LEAST_M) + 1 / jnp.maximum(right.range_m, LEAST_M))
    return replace(
        scan,
        hit=scan.hit | hole,
        range_m=jnp.where(hole, between, scan.range_m),
        intensity=jnp.where(hole, (left.intensity + right.intensity) / 2, scan.intensity),
        incidence_rad=jnp.where(hole, (left.incidence_rad + right.incidence_rad) / 2, scan.incidence_rad),
        semantic=jnp.where(hole, left.semantic, scan.semantic),
        instance=jnp.where(hole, left.instance, scan.instance),
        rgb=jnp.where(hole[..., None], left.rgb, scan.rgb),
    )
