"""Surfaces made smooth: planes through the ranges, intensities and angles of a ray and its neighbours.

On a plane q = 1 / range is linear in the ray's direction: least squares on the direction's parts along the middle ray,
to its left and up give the plane; the first coefficient is the middle ray's own q.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float

from jaxsim.discover.model.noise_levels import STEEPEST_COSINE, beside
from jaxsim.effects.rays import FLOOR, Scan
from jaxsim.frame import Array

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
STEEPEST_SLOPE = 3.0
"""Tangent of the steepest incidence at which a neighbour of a row is looked for on a ray's own surface ..."""
JUMP = 0.03
"""... beside a step of this share of 1 / range."""
PLANE_MISFIT = 1.5
"""Scatter about a window's plane over that of noise, up to which it is a plane."""
MOST_RANGE_LEVERAGE = 0.6
"""Variance of a smooth range over a ray's own, up to which it is taken instead."""
RIDGE = 1e-2
"""Pull of a window's slopes to 0, in rays at its end."""
ROUNDS = 3
"""Of weights given a line and a line given weights."""


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

    def frame(rasters: dict[str, Array]) -> dict[str, Array]:
        one = replace(scan, **{name: raster[None] for name, raster in rasters.items()})
        smooth = _smooth_frame(one, half=half, by_cosine=by_cosine, range_sd_m=range_sd_m, intensity_sd=intensity_sd)
        return {name: getattr(smooth, name)[0] for name in Smooth.__dataclass_fields__}

    return Smooth(**jax.lax.map(frame, {name: getattr(scan, name) for name in each}))


@struct.dataclass
class _Window:
    """Each ray of a frame with its neighbours, k of them, itself in the middle."""

    ratio: Float[Array, "k 1 r c"]
    """1 / range over the ray's own."""
    level: Float[Array, "k 1 r c"]
    """Intensity, over the cosine where it follows that."""
    cosine: Float[Array, "k 1 r c"]
    """1 where the intensity follows none."""
    angle: Float[Array, "k 1 r c"]
    same: Bool[Array, "k 1 r c"]
    """Whether it may be of the same surface."""
    along: Float[Array, "k 1 r c"]
    """The neighbour's direction along the ray, to its left and up, the latter two over the window's width."""
    left: Float[Array, "k 1 r c"]
    up: Float[Array, "k 1 r c"]

    @property
    def design(self) -> list[Array]:
        """Terms in which 1 / range of a plane is linear."""
        return [self.along, self.left, self.up]

    @property
    def bent(self) -> list[Array]:
        """The same with squares, for cylinders and other surfaces that bend."""
        return [*self.design, self.left**2, self.up**2]


def _smooth_frame(
    scan: Scan, *, half: int, by_cosine: bool, range_sd_m: Float[Array, ""], intensity_sd: Float[Array, " 2"]
) -> Smooth:
    reach = half * jnp.abs(scan.grid.azimuth_rad[0] - scan.grid.azimuth_rad[1])
    window = _window(scan, half=half, by_cosine=by_cosine, reach=reach)
    middle = window.ratio.shape[0] // 2
    own_q = 1 / jnp.maximum(scan.range_m, 0.1)
    weight, off = _weights(window, noise=range_sd_m * own_q)
    gram = _gram(window.bent, weight)
    of_ratio = _solved(gram, _moments(window.bent, weight, window.ratio))
    of_angle = _solved(gram, _moments(window.bent, weight, window.angle))
    range_leverage = _solved(gram, _unit(gram))[0]
    albedo, leverage = _levels(window, weight, intensity_sd)

    trusted = (weight.sum(0) > FEWEST_BESIDE) & (leverage < MOST_LEVERAGE) & (of_ratio[0] > 0.5)
    misfit = jnp.sqrt((weight * off**2).sum(0) / jnp.maximum(weight.sum(0), 1e-6))
    plane = trusted & (weight[middle] > 0) & (range_leverage < MOST_RANGE_LEVERAGE)
    plane = plane & (misfit < PLANE_MISFIT * jnp.maximum(range_sd_m * own_q, 1e-4))
    # The plane's normal is (1, u, v) by middle ray, left and up (effects.scan).
    u, v = of_ratio[1] / of_ratio[0] / reach, of_ratio[2] / of_ratio[0] / reach
    own_level = window.level[middle]
    albedo = jnp.where(trusted & (albedo > FLOOR), albedo, jnp.maximum(own_level, FLOOR))
    return Smooth(
        range_m=jnp.where(plane, scan.range_m / of_ratio[0], scan.range_m),
        range_leverage=jnp.where(plane, range_leverage, 1.0),
        plane_rad=jnp.where(plane, jnp.arctan(jnp.sqrt(u**2 + v**2)), scan.incidence_rad),
        incidence_rad=jnp.where(trusted, jnp.clip(of_angle[0], 0, jnp.pi / 2), scan.incidence_rad),
        # Not of logarithms, in which noise on dark readings is skewed and larger than it is.
        detail=jnp.where(scan.hit, jnp.clip(own_level / albedo - 1, -MOST_DETAIL, MOST_DETAIL), 0.0),
        albedo=albedo,
        trusted=trusted,
        leverage=leverage,
    )


def _window(scan: Scan, *, half: int, by_cosine: bool, reach: Float[Array, ""]) -> _Window:
    azimuth, elevation = scan.grid.azimuth_rad, scan.grid.elevation_rad
    last = len(elevation) - 1
    row = jnp.arange(last + 1)
    own_q = 1 / jnp.maximum(scan.range_m, 0.1)
    own_e = elevation[None, :, None]
    entries: list[dict[str, Array]] = []
    for rows_up in range(-ROWS, ROWS + 1):
        at = jnp.clip(row + rows_up, 0, last)
        inside = (at == row + rows_up)[None, :, None]
        rasters = ("range_m", "intensity", "incidence_rad", "semantic", "instance")
        rows = replace(scan, **{n: getattr(scan, n)[:, at] for n in rasters}, hit=scan.hit[:, at] & inside)
        e = elevation[at][None, :, None]
        # On level ground 1 / range goes with the sine of the elevation, from row to row by a large step.
        ground = jnp.sin(e) / jnp.minimum(jnp.sin(own_e), -1e-3)
        for shift in sorted({round(k) for k in np.linspace(-half, half, COLUMNS)}):
            there = beside(rows, -shift)
            ratio = 1 / jnp.maximum(there.range_m, 0.1) / own_q
            bent = STEEPEST_SLOPE * jnp.abs(shift * (azimuth[1] - azimuth[0])) + JUMP
            near = (jnp.abs(ratio - 1) < bent) | (jnp.abs(ratio - ground) < JUMP)
            alike = (there.semantic == scan.semantic) & (there.instance == scan.instance)
            cosine = jnp.maximum(jnp.cos(there.incidence_rad), STEEPEST_COSINE)
            cosine = cosine if by_cosine else jnp.ones_like(cosine)
            turn = shift * (azimuth[1] - azimuth[0])
            flat = jnp.cos(e) * jnp.cos(turn)
            along = jnp.cos(own_e) * flat + jnp.sin(own_e) * jnp.sin(e)
            up = jnp.cos(own_e) * jnp.sin(e) - jnp.sin(own_e) * flat
            entries.append(
                {
                    "ratio": ratio,
                    "level": there.intensity / cosine,
                    "cosine": cosine,
                    "angle": there.incidence_rad,
                    "same": there.hit & scan.hit & alike & near,
                    "along": jnp.broadcast_to(along, ratio.shape),
                    "left": jnp.broadcast_to(jnp.cos(e) * jnp.sin(turn) / reach, ratio.shape),
                    "up": jnp.broadcast_to(up / reach, ratio.shape),
                }
            )
    return _Window(**jax.tree.map(lambda *parts: jnp.stack(parts), *entries))


def _weights(
    window: _Window, *, noise: Float[Array, "1 r c"]
) -> tuple[Float[Array, "k 1 r c"], Float[Array, "k 1 r c"]]:
    """Tukey's biweight of the distances to the plane through a window, and these, over the ray's own 1 / range."""
    # What is farther off than noise explains is another surface.
    limit = jnp.maximum(4 * noise, 0.01)[None]
    weight = window.same.astype(jnp.float32)
    off = jnp.zeros_like(weight)
    for _ in range(ROUNDS):
        surface = _solved(_gram(window.bent, weight), _moments(window.bent, weight, window.ratio))
        off = window.ratio - sum(term * c[None] for term, c in zip(window.bent, surface, strict=True))
        weight = jnp.where(window.same & (jnp.abs(off) < limit), (1 - (off / limit) ** 2) ** 2, 0.0)
    return weight, off


def _levels(
    window: _Window, weight: Float[Array, "k 1 r c"], intensity_sd: Float[Array, " 2"]
) -> tuple[Float[Array, "1 r c"], Float[Array, "1 r c"]]:
    """The surface's level at each ray, and its variance over that of one ray.

    Rays count by their precision, which follows from the cosine: those seen at grazing angles say little of it.
    """
    constant, share = intensity_sd[0] ** 2, intensity_sd[1] ** 2
    bright = weight * window.cosine**2
    first = jnp.maximum((bright * window.level).sum(0) / jnp.maximum(bright.sum(0), 1e-9), FLOOR)
    expected = (window.cosine * first[None]) ** 2
    # Of ideal intensities all rays are alike; 1e-12 keeps their precision finite.
    variance = (constant + share * expected + 1e-12) / expected
    precision = weight / variance
    gram = _gram(window.design, precision)
    own = variance[variance.shape[0] // 2]
    level = _solved(gram, _moments(window.design, precision, window.level))[0]
    return level, _solved(gram, _unit(gram))[0] / own


def _gram(design: list[Array], weight: Float[Array, "k 1 r c"]) -> list[list[Array]]:
    """Of weighted least squares, with a little of a prior: where rays are few, slopes are none."""
    gram = [[(weight * p * q).sum(0) for q in design] for p in design]
    for k, line in enumerate(gram):
        line[k] = line[k] + (RIDGE if k else 1e-6)
    return gram


def _moments(design: list[Array], weight: Float[Array, "k 1 r c"], y: Float[Array, "k 1 r c"]) -> list[Array]:
    return [(weight * p * y).sum(0) for p in design]


def _unit(gram: list[list[Array]]) -> list[Array]:
    """Right side whose solution begins with the variance of the first coefficient."""
    one = jnp.ones_like(gram[0][0])
    return [one, *[jnp.zeros_like(one)] * (len(gram) - 1)]


def _solved(gram: list[list[Array]], right: list[Array]) -> list[Array]:
    """Gauss elimination of many small symmetric positive systems at once, each entry an array."""
    gram, right = [list(line) for line in gram], list(right)
    size = len(right)
    for k in range(size):
        for below in range(k + 1, size):
            factor = gram[below][k] / gram[k][k]
            gram[below] = [g - factor * pivot for g, pivot in zip(gram[below], gram[k], strict=True)]
            right[below] = right[below] - factor * right[k]
    for k in reversed(range(size)):
        for j in range(k + 1, size):
            right[k] = right[k] - gram[k][j] * right[j]
        right[k] = right[k] / gram[k][k]
    return right


def half_width(scan: Scan) -> int:
    azimuth = np.asarray(scan.grid.azimuth_rad, float)
    step = float(np.median(np.abs(np.angle(np.exp(1j * np.diff(azimuth))))))
    return int(np.clip(round(REACH_RAD / max(step, 1e-6)), LEAST_HALF, MOST_HALF))
