"""What a simulator means, behind noise of its own: its level of noise from its frames alone, and frames without it.

A simulator that adds noise (CARLA, Isaac, Gazebo and RGL do when asked) or learned from noisy drives is a noisy reading
of what it means. Regressed on a noisy predictor, what was measured follows it too weakly (errors in variables; Fuller
1987), and every effect that bends intensities would explain that. So the detail within a surface is shrunk to the share
that is not noise (regression calibration; Carroll, Ruppert, Stefanski, Crainiceanu 2006), and how far the sensor
follows the rest is left to a nuisance (`Evidence.features`).

Letters: q = 1 / range, linear in the azimuth on a plane; j = intensity over the cosine of the incidence that the
simulator gives; second differences along a row, over sqrt 6, have the noise's variance and no slope.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import nnls

from jaxsim.discover.model.lattice import FINEST, lattice_step
from jaxsim.effects.planes import slopes_of
from jaxsim.effects.rays import FLOOR, Scan, spans_turn
from jaxsim.frame import Array

QUANTILE = 0.25
"""Of absolute second differences, from which noise is told: texture and edges fill the upper ones."""
NORMAL_QUANTILE = 0.31864
"""The same quantile of |N(0, 1)|."""
BINS = 12
"""Of intensity, over which noise is told apart into a constant and a proportional part."""
FEWEST = 400
"""Second differences that a bin needs."""
LEAST_RANGE_M = 0.004
"""Range noise below which a simulator counts as ideal: curved surfaces have as much."""
LEAST_INTENSITY = 0.01
"""The same of intensity, as a share of it."""
LEAST_LOSS = 0.001
"""Share of rays lost within smooth surfaces below which holes are the street's."""
REACH_RAD = np.deg2rad(2.5)
"""Half width of the windows in which surfaces are made smooth along a row."""
LEAST_HALF, MOST_HALF = 4, 16
"""The same in columns, at least and at most."""
FEWEST_BESIDE = 5.0
"""Rays of a surface in a window, by weight, that say what the simulator means."""
ROUNDS = 3
"""Of weights given a line and a line given weights."""
MOST_VALUES = 200_000
"""Readings, evenly chosen, in which a lattice is looked for."""
FEWEST_OF_CLASS = 60
"""Rays of a class from which its dependence on angle and range is told."""
STEEPEST_COSINE = 0.1
"""Cosines below this are held there: intensities are not divided by less."""


@dataclass(frozen=True)
class Levels:
    """Noise of frames, the simulator's or the sensor's, each level 0 where it is too small to matter."""

    range_m: float = 0.0
    """Standard deviation of the range."""
    intensity: float = 0.0
    """Of the intensity, the part that is the same for all; 0..1 scale."""
    intensity_share: float = 0.0
    """Of the intensity, the part in proportion to it."""
    loss: float = 0.0
    """Probability that a ray within a smooth surface is lost."""
    intensity_step: float = 0.0
    """Lattice of the intensities; 0 for none."""
    range_step_m: float = 0.0

    @property
    def of_intensity(self) -> bool:
        """Whether intensities are noisy."""
        return self.intensity > 0 or self.intensity_share > 0

    def variance(self, intensity: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Squared standard deviation of ln I at these intensities, nats^2."""
        return self.intensity_share**2 + (self.intensity / np.maximum(intensity, FLOOR)) ** 2


@dataclass(frozen=True)
class Meant:
    """A simulator's frames as it means them."""

    scan: Scan
    detail: Float[Array, "f r c"] | None
    """ln I of each ray over its surface's beside it, nats, as the simulator has it, noise and all; None where
    intensities are not noisy."""
    trusted: Bool[Array, "f r c"] | None
    """Where enough of the surface lies beside a ray to say what is meant."""
    level: Float[Array, "f r c"] | None
    """ln I of each ray's surface beside it."""
    variance: Float[Array, "f r c"] | None
    """Squared standard deviation that noise gives `level`, nats^2 ..."""
    detail_variance: Float[Array, "f r c"] | None
    """... and what the detail that is meant has beyond its trusted share."""
    noise: Levels
    """The simulator's."""
    sensor: Levels
    """The sensor's own, by the same rule: real texture counts as noise where it is as fine as the rays."""


def meant(
    scan: Scan, *, range_m: Float[Array, "f r c"], intensity: Float[Array, "f r c"], valid: Bool[Array, "f r c"]
) -> Meant:
    """The frames that a simulator means, and the noise on them. Without noise the very frames.

    Rays lost within a surface are put back, ranges and intensities made smooth along the rows of each surface. The
    other three are what the sensor read.
    """
    noise = noise_levels(scan)
    sensor = noise_levels(replace(scan, range_m=range_m, intensity=intensity, hit=valid))
    if noise.loss > 0:
        scan = filled(scan)
    if not (noise.range_m > 0 or noise.of_intensity):
        return Meant(_shaped(scan) if noise.loss > 0 else scan, None, None, None, None, None, noise, sensor)
    half = _half_width(scan)
    smooth = smooth_rows(scan, half=half, range_sd_m=jnp.float32(noise.range_m))
    if noise.range_m > 0:
        scan = replace(scan, range_m=smooth.range_m)
    if not noise.of_intensity:
        return Meant(_shaped(scan), None, None, None, None, None, noise, sensor)
    detail = np.asarray(smooth.detail)
    level = np.asarray(scan.intensity) * np.exp(-detail)
    own = noise.variance(level)
    trust = reliability(detail, own, level, where=np.asarray(scan.hit & smooth.trusted))
    scan = replace(scan, intensity=jnp.asarray(level * np.exp(trust * detail), jnp.float32))
    return Meant(
        _shaped(scan),
        smooth.detail,
        smooth.trusted,
        jnp.log(jnp.maximum(jnp.asarray(level, jnp.float32), FLOOR)),
        jnp.asarray(own * np.asarray(smooth.leverage), jnp.float32),
        jnp.asarray(own * trust * (1 - trust), jnp.float32),
        noise,
        sensor,
    )


def _shaped(scan: Scan) -> Scan:
    """The scan with what follows from its ranges made anew."""
    slopes = [slopes_of(scan.grid, r, h) for r, h in zip(scan.range_m, scan.hit, strict=True)]
    return replace(scan, slopes=jnp.stack(slopes))


def _half_width(scan: Scan) -> int:
    azimuth = np.asarray(scan.grid.azimuth_rad, float)
    step = float(np.median(np.abs(np.angle(np.exp(1j * np.diff(azimuth))))))
    return int(np.clip(round(REACH_RAD / max(step, 1e-6)), LEAST_HALF, MOST_HALF))


def noise_levels(scan: Scan) -> Levels:
    """The levels of noise of frames, from differences between rays of one surface along a row."""
    inner, hole = _neighbourhoods(scan)
    inner, hole = np.asarray(inner), np.asarray(hole)
    if inner.sum() < FEWEST:
        return Levels(**own_steps(scan))
    range_m = np.asarray(scan.range_m, np.float64)
    bend = _second_difference(1 / np.maximum(range_m, 0.1))
    range_sd = _sd_of(np.abs(bend * range_m**2)[inner])
    loss = hole.sum() / max(hole.sum() + inner.sum(), 1)
    constant, share = _intensity_noise(scan, inner)
    return Levels(
        range_m=range_sd if range_sd > LEAST_RANGE_M else 0.0,
        intensity=constant,
        intensity_share=share,
        loss=float(loss) if loss > LEAST_LOSS else 0.0,
        **own_steps(scan),
    )


def own_steps(scan: Scan) -> dict[str, float]:
    """Lattices of simulated readings, by the names of `Levels`; 0 for none."""
    hit = np.flatnonzero(np.asarray(scan.hit))
    hit = hit[:: max(1, len(hit) // MOST_VALUES)]
    intensity, range_m = np.asarray(scan.intensity).ravel()[hit], np.asarray(scan.range_m).ravel()[hit]
    return {
        "intensity_step": lattice_step(intensity, finest=FINEST["intensity_quantization"]),
        "range_step_m": lattice_step(range_m, finest=FINEST["range_quantization"]),
    }


def _second_difference(x: Float[np.ndarray, "f r c"]) -> Float[np.ndarray, "f r c"]:
    """Of each ray with its neighbours along the row, over sqrt 6. Past the borders it means nothing."""
    return (np.roll(x, 1, 2) - 2 * x + np.roll(x, -1, 2)) / np.sqrt(6)


def _sd_of(size: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of normal noise of which these are absolute values, others among them that are larger."""
    return float(np.quantile(size, QUANTILE) / NORMAL_QUANTILE)


@jax.jit
def _neighbourhoods(scan: Scan) -> tuple[Bool[Array, "f r c"], Bool[Array, "f r c"]]:
    """Rays whose neighbours to both sides go on with their surface; and rays that hit nothing between two such."""
    left, right = (_beside(scan, k) for k in (1, -1))
    alike = left.hit & right.hit & (left.semantic == right.semantic) & (left.instance == right.instance)
    q_left, q_right = 1 / jnp.maximum(left.range_m, 0.1), 1 / jnp.maximum(right.range_m, 0.1)
    middle = (q_left + q_right) / 2
    alike = alike & (jnp.abs(q_left - q_right) < 0.1 * middle)
    own = scan.hit & (scan.semantic == left.semantic) & (scan.instance == left.instance)
    own = own & (jnp.abs(1 / jnp.maximum(scan.range_m, 0.1) - middle) < 0.03 * middle)
    return alike & own, alike & ~scan.hit


def _beside(scan: Scan, shift: int) -> Scan:
    """The scan turned by some columns; what comes in past a border hits nothing."""
    column = jnp.arange(scan.range_m.shape[2])
    inside = (column - shift >= 0) & (column - shift < len(column))
    inside = inside | spans_turn(scan.grid)
    turned = {
        name: jnp.roll(getattr(scan, name), shift, axis=2)
        for name in ("range_m", "hit", "intensity", "incidence_rad", "semantic", "instance", "rgb")
    }
    return replace(scan, **(turned | {"hit": turned["hit"] & inside}))


def _intensity_noise(scan: Scan, inner: Bool[np.ndarray, "f r c"]) -> tuple[float, float]:
    """The constant part of the noise on intensities, and the part in proportion to them; both 0 where they are
    small."""
    intensity = np.asarray(scan.intensity, np.float64)
    bright = inner & (np.roll(intensity, 1, 2) > FLOOR) & (np.roll(intensity, -1, 2) > FLOOR) & (intensity > FLOOR)
    if bright.sum() < FEWEST:
        return 0.0, 0.0
    variances = []
    # Intensities that follow the simulator's own normals follow their noise too; that is no noise on the intensity.
    for given in (np.ones_like(intensity), _cosine(scan)):
        size = np.abs(_second_difference(intensity / given)) * given
        level = (np.roll(intensity, 1, 2) + intensity + np.roll(intensity, -1, 2)) / 3
        variances.append(_by_level(size[bright], level[bright]))
    level, variance = min(variances, key=lambda pair: pair[1].mean())
    # Weighted by the relative error: a line through variance / level^2 = share^2 + constant^2 / level^2.
    design = np.stack([np.ones_like(level), 1 / level**2], 1) * (level**2 / variance.clip(1e-12))[:, None]
    (share, constant), _ = nnls(design, np.ones_like(level))
    if np.median(np.sqrt(variance) / level) < LEAST_INTENSITY:
        return 0.0, 0.0
    # A constant that even the darkest readings hardly show is none.
    if constant < 4 * share * level[0] ** 2:
        return 0.0, float(np.sqrt(np.median(variance / level**2)))
    return float(np.sqrt(constant)), float(np.sqrt(share))


def _by_level(
    size: Float[np.ndarray, " n"], level: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Median level of each bin of it, and the variance of the noise there."""
    order = np.argsort(level)
    bins = np.array_split(order, max(1, min(BINS, len(order) // FEWEST)))
    return np.array([np.median(level[b]) for b in bins]), np.array([_sd_of(size[b]) ** 2 for b in bins])


def _cosine(scan: Scan) -> Float[np.ndarray, "f r c"]:
    return np.maximum(np.cos(np.asarray(scan.incidence_rad, np.float64)), STEEPEST_COSINE)


@jax.jit
def filled(scan: Scan) -> Scan:
    """The scan with single rays put back that it lost within a surface: between their two neighbours."""
    _, hole = _neighbourhoods(scan)
    left, right = _beside(scan, 1), _beside(scan, -1)
    between = 2 / (1 / jnp.maximum(left.range_m, 0.1) + 1 / jnp.maximum(right.range_m, 0.1))
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


@dataclass(frozen=True)
class Smooth:
    """Frames made smooth along the rows of each surface."""

    range_m: Float[Array, "f r c"]
    detail: Float[Array, "f r c"]
    trusted: Bool[Array, "f r c"]
    leverage: Float[Array, "f r c"]
    """Variance of a window's mean over that of one ray."""


jax.tree_util.register_dataclass(Smooth, ["range_m", "detail", "trusted", "leverage"], [])


@partial(jax.jit, static_argnames="half")
def smooth_rows(scan: Scan, *, half: int, range_sd_m: Float[Array, ""]) -> Smooth:
    """Lines through 1 / range, and through the intensity over the cosine, of each ray's surface within `half` columns
    to each side (robust least squares, Tukey's biweight in the range)."""

    def frame(one: Scan) -> Smooth:
        return _smooth_frame(one, half=half, range_sd_m=range_sd_m)

    each = ("range_m", "hit", "intensity", "incidence_rad", "semantic", "instance")
    return jax.lax.map(
        lambda rasters: frame(replace(scan, **{n: rasters[n][None] for n in each})), {n: getattr(scan, n) for n in each}
    )


def _smooth_frame(scan: Scan, *, half: int, range_sd_m: Float[Array, ""]) -> Smooth:
    q = 1 / jnp.maximum(scan.range_m, 0.1)
    cosine = jnp.maximum(jnp.cos(scan.incidence_rad), STEEPEST_COSINE)
    level = scan.intensity / cosine
    offsets = range(-half, half + 1)
    shifted = [_beside(scan, -k) for k in offsets]
    near_q = jnp.stack([1 / jnp.maximum(s.range_m, 0.1) for s in shifted])
    near_j = jnp.stack([s.intensity / jnp.maximum(jnp.cos(s.incidence_rad), STEEPEST_COSINE) for s in shifted])
    same = jnp.stack([s.hit & (s.semantic == scan.semantic) & (s.instance == scan.instance) for s in shifted])
    same = same & scan.hit[None]
    away = jnp.asarray([float(k) for k in offsets])[:, None, None, None]
    # Of a line through q: what is farther off than noise explains is another surface.
    scale = jnp.maximum(4 * range_sd_m * q, 0.01)
    weight = same & (jnp.abs(near_q / q[None] - 1) < 0.02 * jnp.abs(away) + scale[None])
    weight = weight.astype(jnp.float32)
    for _ in range(ROUNDS):
        centre, slope = _line(near_q, weight, away)
        off = (near_q - centre[None] - slope[None] * away) / q[None] / scale[None]
        weight = same * jnp.where(jnp.abs(off) < 1, (1 - off**2) ** 2, 0.0)
    centre = _parabola(near_q / q[None] - 1, weight, away)
    own = weight[half] > 0
    trusted = own & (weight.sum(0) > FEWEST_BESIDE)
    smooth_m = jnp.where(trusted, scan.range_m / jnp.maximum(1 + centre, 0.5), scan.range_m)
    middle, _ = _line(near_j, weight, away)
    middle = jnp.where(trusted & (middle > FLOOR), middle, jnp.maximum(level, FLOOR))
    detail = jnp.where(scan.hit, jnp.log(jnp.maximum(level, FLOOR)) - jnp.log(middle), 0.0)
    total = jnp.maximum(weight.sum(0), 1e-6)
    leverage = jnp.where(trusted, (weight**2).sum(0) / total**2, 1.0)
    return Smooth(smooth_m[0], detail[0], trusted[0], leverage[0])


def _line(
    y: Float[Array, "k f r c"], weight: Float[Array, "k f r c"], away: Float[Array, "k 1 1 1"]
) -> tuple[Float[Array, "f r c"], Float[Array, "f r c"]]:
    """Weighted least squares of y on 1 and `away`: value at 0, and slope; where all weight lies at one place, no
    slope."""
    total = jnp.maximum(weight.sum(0), 1e-6)
    mean_x, mean_y = (weight * away).sum(0) / total, (weight * y).sum(0) / total
    square = (weight * (away - mean_x[None]) ** 2).sum(0)
    slope = (weight * (away - mean_x[None]) * (y - mean_y[None])).sum(0) / jnp.maximum(square, 1e-3)
    return mean_y - slope * mean_x, slope


def _parabola(
    y: Float[Array, "k f r c"], weight: Float[Array, "k f r c"], away: Float[Array, "k 1 1 1"]
) -> Float[Array, "f r c"]:
    """The same on 1, `away` and its square: value at 0. 1 / range of a plane is a sine of the azimuth, whose bend a
    line would take for a longer range."""
    away = away / away.shape[0]
    s0, s1, s2, s3, s4 = [(weight * away**k).sum(0) for k in range(5)]
    y0, y1, y2 = [(weight * away**k * y).sum(0) for k in range(3)]
    # A little of a prior: where rays are few, the bend is none, then the slope.
    s0, s2_slope, s4 = s0 + 1e-6, s2 + 1e-6, s4 + 1e-4
    # Cramer's rule, of which only the value at 0 is needed.
    minors = s2_slope * s4 - s3 * s3, s1 * s4 - s2 * s3, s1 * s3 - s2 * s2_slope
    determinant = s0 * minors[0] - s1 * minors[1] + s2 * minors[2]
    return (y0 * minors[0] - y1 * minors[1] + y2 * minors[2]) / jnp.maximum(determinant, 1e-12)


def reliability(
    detail: Float[np.ndarray, "*n"],
    variance: Float[np.ndarray, "*n"],
    level: Float[np.ndarray, "*n"],
    *,
    where: Bool[np.ndarray, "*n"],
) -> Float[np.ndarray, "*n"]:
    """Share of the variance of `detail` that is not noise of the given `variance`, by the surfaces' intensity `level`
    (Fuller's reliability ratio); 0 where too few rays count to say."""
    if where.sum() < FEWEST:
        return np.zeros_like(level, np.float32)
    order = np.argsort(level[where])
    bins = np.array_split(order, max(1, min(BINS, len(order) // FEWEST)))
    at = np.array([np.median(level[where][b]) for b in bins])
    total = np.array([np.mean(detail[where][b] ** 2) for b in bins])
    noise = np.array([np.mean(variance[where][b]) for b in bins])
    return np.interp(level, at, np.clip(1 - noise / np.maximum(total, 1e-9), 0, 1)).astype(np.float32)


def trend(
    level: Float[np.ndarray, " n"],
    *,
    semantic: Int[np.ndarray, " n"],
    surface: Int[np.ndarray, " n"],
    incidence_rad: Float[np.ndarray, " n"],
    range_m: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """What the simulator says of ln I by class, angle and range, and by the mean of each surface: of so many rays that
    their noise is gone."""
    slant = np.log(np.maximum(np.cos(incidence_rad), STEEPEST_COSINE))
    far = np.log(np.maximum(range_m, 0.1))
    design = np.stack([np.ones_like(slant), slant, slant**2, far, far**2], axis=-1)
    result = np.empty(len(level))
    for kind in np.unique(semantic):
        of = semantic == kind
        # A class of few rays says nothing of angles.
        columns = design[of] if of.sum() >= FEWEST_OF_CLASS else design[of][:, :1]
        result[of] = columns @ np.linalg.lstsq(columns, level[of], rcond=None)[0]
    _, at = np.unique(surface, return_inverse=True)
    return result + (np.bincount(at, level - result) / np.bincount(at))[at]
