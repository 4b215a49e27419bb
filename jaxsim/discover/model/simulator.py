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
from flax import struct
from jaxtyping import Bool, Float, Int
from scipy.optimize import nnls

from jaxsim.discover.model.lattice import FINEST, lattice_step
from jaxsim.effects.rays import FLOOR, Scan, spans_turn
from jaxsim.effects.scan import slopes_of
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
AS_WELL = 1.1
"""Ratio of variances up to which intensities follow the cosine as well as they follow none."""
LEAST_INCIDENCE_RAD = np.deg2rad(0.5)
"""The same of angles of incidence."""
LEAST_LOSS = 0.001
"""Share of rays lost within smooth surfaces below which holes are the street's."""
REACH_RAD = np.deg2rad(2.5)
"""Half width of the windows in which surfaces are made smooth."""
LEAST_HALF, MOST_HALF = 4, 16
"""The same in columns, at least and at most."""
ROWS, COLUMNS = 2, 9
"""Rows to each side, and columns in all, of which a window is made."""
FEWEST_BESIDE = 6.0
"""Rays of a surface in a window, by weight, that say what the simulator means ..."""
MOST_LEVERAGE = 0.3
"""... unless they lie so that the level is as uncertain as that of three rays."""
MOST_DETAIL = 1.0
"""Intensities off their surface's are held within this share of it."""
PLANE_MISFIT = 1.5
"""Scatter about a window's plane over that of noise, up to which it is a plane."""
RIDGE = 1e-2
"""Pull of a window's slopes to 0, in rays at its end."""
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
    incidence_rad: float = 0.0
    """Of the simulator's angles of incidence."""
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


@dataclass(frozen=True)
class Meant:
    """A simulator's frames as it means them."""

    scan: Scan
    range_variance: Float[Array, "f r c"] | None
    """Squared standard deviation that noise leaves on the ranges that are meant, m^2; None where they are not noisy."""
    planes_rad: Float[Array, "f r c"] | None
    """Incidence on the planes of the ranges that are meant; None where ranges are not noisy."""
    detail: Float[Array, "f r c"] | None
    """Intensity of each ray over its surface's beside it, less 1, as the simulator has it, noise and all; None where
    intensities are not noisy."""
    trusted: Bool[Array, "f r c"] | None
    """Where enough of the surface lies beside a ray to say what is meant."""
    level: Float[Array, "f r c"] | None
    """ln I of each ray's surface beside it."""
    leverage: Float[Array, "f r c"] | None
    """Variance that noise gives `level` over that of one ray."""
    detail_variance: Float[Array, "f r c"] | None
    """Squared standard deviation of the detail that is meant about its trusted share, nats^2."""
    noise: Levels
    """The simulator's."""
    sensor: Levels
    """The sensor's own, by the same rule: real texture counts as noise where it is as fine as the rays."""


def meant(
    scan: Scan, *, range_m: Float[Array, "f r c"], intensity: Float[Array, "f r c"], valid: Bool[Array, "f r c"]
) -> Meant:
    """The frames that a simulator means, and the noise on them. Without noise the very frames.

    Rays lost within a surface are put back, ranges and intensities made smooth within each surface. The
    other three are what the sensor read.
    """
    noise = noise_levels(scan)
    sensor = noise_levels(replace(scan, range_m=range_m, intensity=intensity, hit=valid))
    if noise.loss > 0:
        scan = filled(scan)
    if not (noise.range_m > 0 or noise.of_intensity):
        return Meant(_shaped(scan) if noise.loss > 0 else scan, None, None, None, None, None, None, None, noise, sensor)
    smooth = smooth_frames(
        scan,
        half=_half_width(scan),
        by_cosine=noise.follows_cosine,
        range_sd_m=jnp.float32(noise.range_m),
        intensity_sd=jnp.array([noise.intensity, noise.intensity_share], jnp.float32),
    )
    if noise.incidence_rad > 0:
        scan = replace(scan, incidence_rad=smooth.incidence_rad)
    planes, range_variance = None, None
    if noise.range_m > 0:
        scan = replace(scan, range_m=smooth.range_m)
        planes = smooth.plane_rad
        range_variance = noise.range_m**2 * smooth.range_leverage
    if not noise.of_intensity:
        return Meant(_shaped(scan), range_variance, planes, None, None, None, None, None, noise, sensor)
    detail = np.asarray(smooth.detail)
    level = np.asarray(smooth.albedo) * (_cosine(scan) if noise.follows_cosine else 1.0)
    own = noise.variance(level)
    trusted = np.asarray(scan.hit & smooth.trusted)
    trust = reliability(detail, own, level, semantic=np.asarray(scan.semantic), where=trusted)
    scan = replace(scan, intensity=jnp.asarray(level * np.exp(trust * detail), jnp.float32))
    return Meant(
        _shaped(scan),
        range_variance,
        planes,
        smooth.detail,
        smooth.trusted,
        jnp.log(jnp.maximum(jnp.asarray(level, jnp.float32), FLOOR)),
        smooth.leverage,
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
    steps = own_steps(scan)
    if inner.sum() < FEWEST:
        return steps
    range_m = np.asarray(scan.range_m, np.float64)
    bend = _second_difference(1 / np.maximum(range_m, 0.1))
    range_sd = _sd_of(np.abs(bend * range_m**2)[inner])
    slant_sd = _sd_of(np.abs(_second_difference(np.asarray(scan.incidence_rad, np.float64)))[inner])
    loss = hole.sum() / max(hole.sum() + inner.sum(), 1)
    constant, share, follows_cosine = _intensity_noise(scan, inner)
    return Levels(
        range_m=range_sd if range_sd > LEAST_RANGE_M else 0.0,
        incidence_rad=slant_sd if slant_sd > LEAST_INCIDENCE_RAD else 0.0,
        intensity=constant,
        intensity_share=share,
        follows_cosine=follows_cosine,
        loss=float(loss) if loss > LEAST_LOSS else 0.0,
        intensity_step=steps.intensity_step,
        range_step_m=steps.range_step_m,
    )


def own_steps(scan: Scan) -> Levels:
    """The lattices of readings alone."""
    hit = np.flatnonzero(np.asarray(scan.hit))
    hit = hit[:: max(1, len(hit) // MOST_VALUES)]
    intensity, range_m = np.asarray(scan.intensity).ravel()[hit], np.asarray(scan.range_m).ravel()[hit]
    return Levels(
        intensity_step=lattice_step(intensity, finest=FINEST["intensity_quantization"]),
        range_step_m=lattice_step(range_m, finest=FINEST["range_quantization"]),
    )


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


def _intensity_noise(scan: Scan, inner: Bool[np.ndarray, "f r c"]) -> tuple[float, float, bool]:
    """The constant part of the noise on intensities, and the part in proportion to them, both 0 where they are small;
    and whether intensities follow the cosine of the given incidence."""
    intensity = np.asarray(scan.intensity, np.float64)
    bright = inner & (np.roll(intensity, 1, 2) > FLOOR) & (np.roll(intensity, -1, 2) > FLOOR) & (intensity > FLOOR)
    if bright.sum() < FEWEST:
        return 0.0, 0.0, False
    variances = []
    # Intensities that follow the simulator's own normals follow their noise too; that is no noise on the intensity.
    for given in (np.ones_like(intensity), _cosine(scan)):
        size = np.abs(_second_difference(intensity / given)) * given
        level = (np.roll(intensity, 1, 2) + intensity + np.roll(intensity, -1, 2)) / 3
        variances.append(_by_level(size[bright], level[bright]))
    # In doubt it does: over the cosine, intensities bend less along a surface.
    follows_cosine = bool(np.mean(variances[1][1]) < AS_WELL * np.mean(variances[0][1]))
    level, variance = variances[follows_cosine]
    # Weighted by the relative error: a line through variance / level^2 = share^2 + constant^2 / level^2.
    design = np.stack([np.ones_like(level), 1 / level**2], 1) * (level**2 / variance.clip(1e-12))[:, None]
    (share, constant), _ = nnls(design, np.ones_like(level))
    if np.median(np.sqrt(variance) / level) < LEAST_INTENSITY:
        return 0.0, 0.0, False
    # A constant that even the darkest readings hardly show is none.
    if constant < 4 * share * level[0] ** 2:
        return 0.0, float(np.sqrt(np.median(variance / level**2))), follows_cosine
    return float(np.sqrt(constant)), float(np.sqrt(share)), follows_cosine


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


@struct.dataclass
class Smooth:
    """Frames made smooth within each surface."""

    range_m: Float[Array, "f r c"]
    range_leverage: Float[Array, "f r c"]
    """Variance of that range over a noisy one's."""
    plane_rad: Float[Array, "f r c"]
    """Incidence on the plane through the ranges."""
    incidence_rad: Float[Array, "f r c"]
    """The simulator's own, made smooth."""
    detail: Float[Array, "f r c"]
    """Intensity over that of the surface beside the ray, less 1."""
    albedo: Float[Array, "f r c"]
    """Of the surface: intensity, over the cosine where it follows that."""
    trusted: Bool[Array, "f r c"]
    leverage: Float[Array, "f r c"]
    """Variance of the surface's level over that of one ray."""


@partial(jax.jit, static_argnames=("half", "by_cosine"))
def smooth_frames(
    scan: Scan, *, half: int, by_cosine: bool, range_sd_m: Float[Array, ""], intensity_sd: Float[Array, " 2"]
) -> Smooth:
    """Planes through 1 / range, the intensity (`by_cosine`: over the cosine, for cylinders' sake) and the incidence of
    each ray's surface, within `half` columns and ROWS rows of it.

    On a plane 1 / range is linear in the ray's direction: least squares on its parts along the middle ray, to its left
    and up, with Tukey's biweight of the ranges as weights; the first coefficient is the middle ray's.
    """
    each = ("range_m", "hit", "intensity", "incidence_rad", "semantic", "instance")

    def frame(rasters: dict[str, Array]) -> Smooth:
        one = replace(scan, **{name: raster[None] for name, raster in rasters.items()})
        smooth = _smooth_frame(one, half=half, by_cosine=by_cosine, range_sd_m=range_sd_m, intensity_sd=intensity_sd)
        return jax.tree.map(lambda raster: raster[0], smooth)

    return jax.lax.map(frame, {name: getattr(scan, name) for name in each})


def _smooth_frame(
    scan: Scan, *, half: int, by_cosine: bool, range_sd_m: Float[Array, ""], intensity_sd: Float[Array, " 2"]
) -> Smooth:
    def cosine_of(of: Scan) -> Float[Array, "1 r c"]:
        seen = jnp.maximum(jnp.cos(of.incidence_rad), STEEPEST_COSINE)
        return seen if by_cosine else jnp.ones_like(seen)

    azimuth, elevation = scan.grid.azimuth_rad, scan.grid.elevation_rad
    step = azimuth[0] - azimuth[1]
    last = len(elevation) - 1
    row = jnp.arange(last + 1)
    own_q = 1 / jnp.maximum(scan.range_m, 0.1)
    own_cosine = cosine_of(scan)
    own_level = scan.intensity / own_cosine
    columns = sorted({round(k) for k in np.linspace(-half, half, COLUMNS)})
    ratios, levels, cosines, angles, along, left, up, alike = [], [], [], [], [], [], [], []
    for rows_up in range(-ROWS, ROWS + 1):
        at = jnp.clip(row + rows_up, 0, last)
        inside = (at == row + rows_up)[None, :, None]
        there = replace(
            scan,
            **{n: getattr(scan, n)[:, at] for n in ("range_m", "intensity", "incidence_rad", "semantic", "instance")},
            hit=scan.hit[:, at] & inside,
        )
        ground = (jnp.sin(elevation[at]) / jnp.minimum(jnp.sin(elevation), -1e-3))[None, :, None]
        for shift in columns:
            s = _beside(there, -shift)
            ratio = 1 / jnp.maximum(s.range_m, 0.1) / own_q
            near = jnp.abs(ratio - 1) < 0.02 * abs(shift) + 0.03
            near = near | (jnp.abs(ratio - ground) < 0.03)
            same = s.hit & scan.hit & (s.semantic == scan.semantic) & (s.instance == scan.instance) & near
            ratios.append(ratio)
            cosines.append(cosine_of(s))
            levels.append(s.intensity / cosines[-1])
            angles.append(s.incidence_rad)
            turn = -shift * step
            e, there_e = elevation[None, :, None], elevation[at][None, :, None]
            flat = jnp.cos(there_e) * jnp.cos(turn)
            for terms, part in (
                (along, jnp.cos(e) * flat + jnp.sin(e) * jnp.sin(there_e)),
                (left, jnp.cos(there_e) * jnp.sin(turn)),
                (up, jnp.cos(e) * jnp.sin(there_e) - jnp.sin(e) * flat),
            ):
                terms.append(jnp.broadcast_to(part, ratio.shape))
            alike.append(same)
    ratio, level, angle, same = jnp.stack(ratios), jnp.stack(levels), jnp.stack(angles), jnp.stack(alike)
    cosine = jnp.stack(cosines)
    # Slopes in units of the window's width, so that all terms are of one size.
    reach = half * jnp.abs(step)
    design = [jnp.stack(along), jnp.stack(left) / reach, jnp.stack(up) / reach]
    # What is farther off than noise explains is another surface.
    scale = jnp.maximum(4 * range_sd_m * own_q, 0.01)[None]
    weight = same.astype(jnp.float32)
    for _ in range(ROUNDS):
        gram = _gram(design, weight)
        fitted = _solved(gram, _moments(design, weight, ratio))
        off = (ratio - sum(d * c[None] for d, c in zip(design, fitted, strict=True))) / scale
        weight = same * jnp.where(jnp.abs(off) < 1, (1 - off**2) ** 2, 0.0)
    gram = _gram(design, weight)
    of_ratio = _solved(gram, _moments(design, weight, ratio))
    of_angle = _solved(gram, _moments(design, weight, angle))
    one = jnp.ones_like(own_q)
    first_row = [one, 0 * one, 0 * one]
    of_range = _solved(gram, first_row)[0]
    # Levels by the precision of each ray, which follows from its cosine: rays seen at grazing angles say little.
    share2, constant2 = intensity_sd[1] ** 2, intensity_sd[0] ** 2
    seen = weight * cosine**2
    first = jnp.maximum((seen * level).sum(0) / jnp.maximum(seen.sum(0), 1e-9), FLOOR)
    precision = weight * (cosine * first[None]) ** 2 / (constant2 + share2 * (cosine * first[None]) ** 2 + 1e-12)
    gram = _gram(design, precision)
    of_level = _solved(gram, _moments(design, precision, level))
    own_variance = share2 + constant2 / (first * own_cosine) ** 2 + 1e-12
    leverage = _solved(gram, first_row)[0] / own_variance
    misfit = jnp.sqrt((weight * off**2).sum(0) / jnp.maximum(weight.sum(0), 1e-6)) * scale[0]
    middle_weight = weight[len(columns) * ROWS + len(columns) // 2]
    plane = (middle_weight > 0) & (misfit < PLANE_MISFIT * jnp.maximum(range_sd_m * own_q, 1e-4))
    trusted = (weight.sum(0) > FEWEST_BESIDE) & (leverage < MOST_LEVERAGE) & (of_ratio[0] > 0.5)
    # The plane's normal is (1, u, v) by middle ray, left and up (effects.scan).
    u, v = of_ratio[1] / of_ratio[0] / reach, of_ratio[2] / of_ratio[0] / reach
    slant = jnp.arctan(jnp.sqrt(u**2 + v**2))
    middle = jnp.where(trusted & (of_level[0] > FLOOR), of_level[0], jnp.maximum(own_level, FLOOR))
    return Smooth(
        range_m=jnp.where(trusted & plane, scan.range_m / of_ratio[0], scan.range_m),
        range_leverage=jnp.where(trusted & plane, of_range, 1.0),
        plane_rad=jnp.where(trusted & plane, slant, scan.incidence_rad),
        incidence_rad=jnp.where(trusted, jnp.clip(of_angle[0], 0, jnp.pi / 2), scan.incidence_rad),
        # Not of logarithms, in which noise on dark readings is skewed and larger than it is.
        detail=jnp.where(scan.hit, jnp.clip(own_level / middle - 1, -MOST_DETAIL, MOST_DETAIL), 0.0),
        albedo=middle,
        trusted=trusted,
        leverage=leverage,
    )


Terms = list[Float[Array, "*n"]]


def _gram(design: Terms, weight: Float[Array, "k *n"]) -> list[Terms]:
    """Of weighted least squares, with a little of a prior: where rays are few, slopes are none."""
    gram = [[(weight * p * q).sum(0) for q in design] for p in design]
    for k, line in enumerate(gram):
        line[k] = line[k] + (RIDGE if k else 1e-6)
    return gram


def _moments(design: Terms, weight: Float[Array, "k *n"], y: Float[Array, "k *n"]) -> Terms:
    return [(weight * p * y).sum(0) for p in design]


def _solved(gram: list[Terms], right: Terms) -> Terms:
    """Gauss elimination of many small symmetric positive systems at once, each entry an array."""
    gram, right = [list(line) for line in gram], list(right)
    size = len(right)
    for k in range(size):
        for below in range(k + 1, size):
            factor = gram[below][k] / gram[k][k]
            gram[below] = [g - factor * pivot for g, pivot in zip(gram[below], gram[k], strict=True)]
            right[below] = right[below] - factor * right[k]
    for k in reversed(range(size)):
        known = sum((gram[k][j] * right[j] for j in range(k + 1, size)), start=jnp.zeros_like(right[k]))
        right[k] = (right[k] - known) / gram[k][k]
    return right


def reliability(
    detail: Float[np.ndarray, "*n"],
    variance: Float[np.ndarray, "*n"],
    level: Float[np.ndarray, "*n"],
    *,
    semantic: Int[np.ndarray, "*n"],
    where: Bool[np.ndarray, "*n"],
) -> Float[np.ndarray, "*n"]:
    """Share of the variance of `detail` that is not noise of the given `variance`, by class and by the surfaces'
    intensity `level` (Fuller's reliability ratio); 0 for classes of which too few rays count to say."""
    share = np.zeros(detail.shape, np.float32)
    for kind in np.unique(semantic[where]):
        of = where & (semantic == kind)
        if of.sum() < FEWEST_OF_CLASS:
            continue
        order = np.argsort(level[of])
        bins = np.array_split(order, max(1, min(BINS, len(order) // FEWEST)))
        at = np.array([np.median(level[of][b]) for b in bins])
        total = np.array([np.mean(detail[of][b] ** 2) for b in bins])
        noise = np.array([np.mean(variance[of][b]) for b in bins])
        share[of] = np.interp(level[of], at, np.clip(1 - noise / np.maximum(total, 1e-9), 0, 1))
    return share


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
