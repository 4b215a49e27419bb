"""Surfaces made smooth: planes through the ranges, intensities and angles of a ray and its neighbours.

A window is a ray with its neighbours, of which some may lie on its surface. On a plane q = 1 / range is linear in the
ray's direction: least squares on the direction's parts along the middle ray, to its left and up give the plane; the
first coefficient is the middle ray's own q.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.cast import STEEPEST_COSINE
from jaxsim.discover.model.noise_levels import Levels
from jaxsim.effects.rays import FLOOR, LEAST_M, Scan
from jaxsim.frame import Array
from jaxsim.geometry import spans_turn

REACH_RAD = np.deg2rad(2.5)
"""Half width of the windows in which surfaces are made smooth."""
LEAST_HALF, MOST_HALF = 4, 16
"""Half width of these windows in columns, at least and at most, whatever angle that is."""
ROWS, COLUMNS = 2, 9
"""Rows to each side, and columns in all, of which a window is made."""
STEEPEST_SLOPE = 3.0
"""Tangent of the steepest incidence at which a neighbour of a row is looked for on a ray's own surface ..."""
JUMP = 0.03
"""... beside a step of this share of 1 / range."""

OTHER_WALL_RAD, OTHER_WALL_SD = 0.2, 6.0
"""Rays whose angles differ by more than this and so many times their noise see two walls of a corner, or two sides of a
kerb: ranges hardly tell such surfaces apart, and at the corner they meet."""
OTHER_MATERIAL, OTHER_MATERIAL_SD = 0.3, 3.0
"""Intensities that differ by more than this share of them and so many times their noise are of other materials."""
FEWEST_BESIDE = 6.0
"""Rays of a surface in a window, by weight, that say what the simulator means ..."""
MOST_LEVERAGE = 0.3
"""... unless they lie so that the level is as uncertain as that of three rays."""
MOST_DETAIL = 1.0
"""Intensities off their surface's are held within this share of it."""
PLANE_MISFIT = 1.5
"""Scatter about a window's plane over that of noise, up to which it is a plane ..."""
LEAST_SCATTER = 1e-4
"""... of noise of this share of 1 / range at least."""
LEAST_RATIO = 0.5
"""Smooth 1 / range over the ray's own, below which the window has lost its surface."""
MOST_PLANE_SD_RAD = 0.1
"""Error that noise of the ranges leaves on a plane's angle, up to which it tells one: of a window whose rays lie in one
column, slopes across it are unknown."""
MOST_RANGE_LEVERAGE = 0.6
"""Variance of a smooth range over a ray's own, up to which it is taken instead."""
FARTHEST_SD = 4.0
"""A neighbour farther off the plane through a window than so many times the noise is of another surface ..."""
FARTHEST = 0.01
"""... where that is more than this share of 1 / range: surfaces are rough."""
LEAST_OF_NEIGHBOURS = 0.75
"""Share of the neighbours that may be of a ray's surface, by weight, of which its plane must be made."""
SLOPE_PULL = 1e-4
"""Pull of a window's slopes to 0, in rays at its end: slopes are far above the noise. More would bend the ground ..."""
BEND_PULL = 1e-2
"""... and of its bends, which are not."""
LINE_ROUNDS = 3
"""Rounds of weights given a line and a line given weights."""


@struct.dataclass
class Smoothing:
    """How frames are made smooth."""

    range_sd_m: Float[Array, ""]
    """Noise of the ranges."""
    intensity_sd: Float[Array, " 2"]
    """Noise of the intensities: the same for all, and as a share of them."""
    incidence_sd_rad: Float[Array, ""]
    """Noise of the angles of incidence."""
    half: int = struct.field(pytree_node=False)
    """Columns to each side that a window has."""
    by_cosine: bool = struct.field(pytree_node=False)
    """Whether intensities are divided by the cosine of the incidence, for cylinders' sake."""

    @classmethod
    def of(cls, scan: Scan, noise: Levels) -> Smoothing:
        """What frames of this noise need."""
        # Steps as turns: the seam of a full turn is one step too, not a jump of 360 degrees.
        azimuth = np.asarray(scan.grid.azimuth_rad, float)
        step = float(np.median(np.abs(np.angle(np.exp(1j * np.diff(azimuth))))))
        return cls(
            range_sd_m=np.float32(noise.range_m),
            intensity_sd=np.array([noise.intensity, noise.intensity_share], np.float32),
            incidence_sd_rad=np.float32(noise.incidence_rad),
            half=int(np.clip(round(REACH_RAD / max(step, 1e-6)), LEAST_HALF, MOST_HALF)),
            by_cosine=noise.follows_cosine,
        )


@struct.dataclass
class Window:
    """Each ray of a row with its neighbours, k of them, itself in the middle."""

    ratio: Float[Array, "k c"]
    """1 / range over the ray's own."""
    level: Float[Array, "k c"]
    """Intensity, over the cosine where it follows that."""
    cosine: Float[Array, "k c"]
    """1 where the intensity follows none."""
    angle: Float[Array, "k c"]
    same: Bool[Array, "k c"]
    """Whether it may be of the same surface."""
    along: Float[Array, "k c"]
    """The neighbour's direction along the ray, to its left and up, the latter two over the window's width."""
    left: Float[Array, "k c"]
    up: Float[Array, "k c"]

    @property
    def design(self) -> list[Array]:
        """Terms in which 1 / range of a plane is linear."""
        return [self.along, self.left, self.up]

    @property
    def bent(self) -> list[Array]:
        """Terms of `design` and the squares of left and up, for cylinders and other surfaces that bend."""
        return [*self.design, self.left**2, self.up**2]


def _neighbours(
    half: int, columns: int
) -> tuple[Int[np.ndarray, "k 1"], Int[np.ndarray, "k 1"], Int[np.ndarray, "k c"]]:
    """Rows up and columns left of each ray of a window, and the columns that they come to, which may lie beyond."""
    across = sorted({round(k) for k in np.linspace(-half, half, COLUMNS)})
    up_by = np.repeat(np.arange(-ROWS, ROWS + 1), len(across))[:, None]
    left_by = np.tile(across, 2 * ROWS + 1)[:, None]
    return up_by, left_by, np.arange(columns) + left_by


def row_window(
    scan: Scan, frame: Int[Array, ""], row: Int[Array, ""], *, how: Smoothing, reach: Float[Array, ""]
) -> Window:
    """The windows of a row of a frame, `reach` radians to each side."""
    azimuth, elevation = scan.grid.azimuth_rad, scan.grid.elevation_rad
    rows, columns = len(elevation), len(azimuth)
    up_by, left_by, column = _neighbours(how.half, columns)
    # A full turn goes on at its other end; a sector has nothing beyond its ends.
    beyond = jnp.asarray((column < 0) | (column >= columns)) & ~spans_turn(scan.grid)
    beyond = beyond | (row + up_by < 0) | (row + up_by >= rows)
    at = jnp.clip(row + up_by, 0, rows - 1), column % columns

    def own(raster: Array) -> Array:
        return raster[frame, row][None]

    def there(raster: Array) -> Array:
        return raster[frame, *at]

    # 1 / range of a plane is linear in the ray's direction, whatever its slope: a plane is a straight line here.
    ratio = jnp.maximum(own(scan.range_m), LEAST_M) / jnp.maximum(there(scan.range_m), LEAST_M)
    e, own_e = elevation[at[0]], elevation[row]
    turn = left_by.astype("f4") * (azimuth[1] - azimuth[0])
    # On level ground 1 / range goes with the sine of the elevation, from row to row by a large step.
    ground = jnp.sin(e) / jnp.minimum(jnp.sin(own_e), -1e-3)
    near = (jnp.abs(ratio - 1) < STEEPEST_SLOPE * jnp.abs(turn) + JUMP) | (jnp.abs(ratio - ground) < JUMP)
    alike = (there(scan.semantic) == own(scan.semantic)) & (there(scan.instance) == own(scan.instance))
    angle = there(scan.incidence_rad)
    parallel = jnp.abs(angle - own(scan.incidence_rad)) < OTHER_WALL_RAD + OTHER_WALL_SD * how.incidence_sd_rad
    cosine = jnp.maximum(jnp.cos(angle), STEEPEST_COSINE) if how.by_cosine else jnp.ones_like(angle)
    level = there(scan.intensity) / cosine
    middle = len(left_by) // 2
    own_level, own_cosine = level[middle][None], cosine[middle][None]
    # A pane a hand's breadth behind its wall is told by what it reflects; ranges alone would mix the two.
    constant = how.intensity_sd[0] ** 2 * (1 / cosine**2 + 1 / own_cosine**2)
    noise = jnp.sqrt(constant + how.intensity_sd[1] ** 2 * (level**2 + own_level**2))
    unlike = jnp.abs(level - own_level) > OTHER_MATERIAL * (level + own_level) / 2 + OTHER_MATERIAL_SD * noise
    # The neighbour's direction in axes of the ray itself, so that every window is solved alike.
    forward = jnp.cos(e) * jnp.cos(turn)
    return Window(
        ratio=ratio,
        level=level,
        cosine=cosine,
        angle=angle,
        same=there(scan.hit) & own(scan.hit) & alike & near & parallel & ~unlike & ~beyond,
        along=jnp.broadcast_to(jnp.cos(own_e) * forward + jnp.sin(own_e) * jnp.sin(e), ratio.shape),
        left=jnp.broadcast_to(jnp.cos(e) * jnp.sin(turn) / reach, ratio.shape),
        up=jnp.broadcast_to((jnp.cos(own_e) * jnp.sin(e) - jnp.sin(own_e) * forward) / reach, ratio.shape),
    )


@struct.dataclass
class Smooth:
    """Frames made smooth within each surface."""

    range_m: Float[Array, "f r c"]
    range_leverage: Float[Array, "f r c"]
    """Variance of that range over a noisy one's."""
    plane_rad: Float[Array, "f r c"]
    """Incidence on the plane through the ranges; the simulator's own where these do not tell it."""
    incidence_rad: Float[Array, "f r c"]
    """The simulator's own, made smooth."""
    detail: Float[Array, "f r c"]
    """Intensity over that of the surface beside the ray, less 1."""
    albedo: Float[Array, "f r c"]
    """Albedo of the surface: intensity, over the cosine where it follows that."""
    trusted: Bool[Array, "f r c"]
    leverage: Float[Array, "f r c"]
    """Variance of the surface's level over that of one ray."""


@jax.jit
def smooth_frames(scan: Scan, how: Smoothing) -> Smooth:
    """Planes through 1 / range, the intensity and the incidence of each ray's surface, within a few columns and rows of
    it, weighted by Tukey's biweight of the ranges."""
    frames, rows, columns = scan.range_m.shape
    # Row by row: the windows of a row stay in a processor's cache, those of a frame do not.
    lines = jax.lax.map(lambda place: _smooth_row(scan, *jnp.divmod(place, rows), how=how), jnp.arange(frames * rows))
    return Smooth(**{name: raster.reshape(frames, rows, columns) for name, raster in lines.items()})


def _smooth_row(scan: Scan, frame: Int[Array, ""], row: Int[Array, ""], *, how: Smoothing) -> dict[str, Array]:
    """The fields of `Smooth` for a row of a frame."""
    reach = how.half * jnp.abs(scan.grid.azimuth_rad[0] - scan.grid.azimuth_rad[1])
    window = row_window(scan, frame, row, how=how, reach=reach)
    range_m, incidence_rad = scan.range_m[frame, row], scan.incidence_rad[frame, row]
    middle = window.ratio.shape[0] // 2
    own_q = 1 / jnp.maximum(range_m, LEAST_M)
    weight, off = _weights(window, noise=how.range_sd_m * own_q)
    gram = _gram(window.bent, weight)
    of_ratio = gram.solve(_moments(window.bent, weight, window.ratio))
    of_angle = gram.solve(_moments(window.bent, weight, window.angle))
    range_leverage = gram.first_variance()
    albedo, leverage = _levels(window, weight, how.intensity_sd)

    trusted = (weight.sum(0) > FEWEST_BESIDE) & (leverage < MOST_LEVERAGE) & (of_ratio[0] > LEAST_RATIO)
    misfit = jnp.sqrt((weight * off**2).sum(0) / jnp.maximum(weight.sum(0), 1e-6))
    plane = trusted & (weight[middle] > 0) & (range_leverage < MOST_RANGE_LEVERAGE)
    # Where many neighbours had to be left out, those that stayed may lie on two surfaces.
    plane = plane & (weight.mean(0) > LEAST_OF_NEIGHBOURS * window.same.mean(0))
    plane = plane & (misfit < PLANE_MISFIT * jnp.maximum(how.range_sd_m * own_q, LEAST_SCATTER))
    # The plane's normal is (1, u, v) by middle ray, left and up (effects.scan).
    u, v = of_ratio[1] / of_ratio[0] / reach, of_ratio[2] / of_ratio[0] / reach
    slope_sd = how.range_sd_m * own_q / reach * gram.slope_sd()
    tilted = plane & (slope_sd / (1 + u**2 + v**2) < MOST_PLANE_SD_RAD)
    angle = jnp.where(trusted, jnp.clip(of_angle[0], 0, jnp.pi / 2), incidence_rad)
    # Angles without noise are better as they are.
    own_angle = jnp.where(how.incidence_sd_rad > 0, angle, incidence_rad)
    own_level = window.level[middle]
    albedo = jnp.where(trusted & (albedo > FLOOR), albedo, jnp.maximum(own_level, FLOOR))
    return {
        "range_m": jnp.where(plane, range_m / of_ratio[0], range_m),
        "range_leverage": jnp.where(plane, range_leverage, 1.0),
        "plane_rad": jnp.where(tilted, jnp.arctan(jnp.sqrt(u**2 + v**2)), own_angle),
        "incidence_rad": angle,
        # Not of logarithms, in which noise on dark readings is skewed and larger than it is.
        "detail": jnp.where(scan.hit[frame, row], jnp.clip(own_level / albedo - 1, -MOST_DETAIL, MOST_DETAIL), 0.0),
        "albedo": albedo,
        "trusted": trusted,
        "leverage": leverage,
    }


def _weights(window: Window, *, noise: Float[Array, " c"]) -> tuple[Float[Array, "k c"], Float[Array, "k c"]]:
    """Tukey's biweight of the distances to the plane through a window, and these, over the ray's own 1 / range."""
    # What is farther off than noise explains is another surface.
    limit = jnp.maximum(FARTHEST_SD * noise, FARTHEST)[None]

    def step(_: Int[Array, ""], before: tuple[Array, Array]) -> tuple[Array, Array]:
        weight = before[0]
        surface = _gram(window.bent, weight).solve(_moments(window.bent, weight, window.ratio))
        off = window.ratio - sum(term * c[None] for term, c in zip(window.bent, surface, strict=True))
        return jnp.where(window.same & (jnp.abs(off) < limit), (1 - (off / limit) ** 2) ** 2, 0.0), off

    start = window.same.astype(jnp.float32), jnp.zeros_like(window.ratio)
    return jax.lax.fori_loop(0, LINE_ROUNDS, step, start)


def _levels(
    window: Window, weight: Float[Array, "k c"], intensity_sd: Float[Array, " 2"]
) -> tuple[Float[Array, " c"], Float[Array, " c"]]:
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
    spread = variance[variance.shape[0] // 2]
    return gram.solve(_moments(window.design, precision, window.level))[0], gram.first_variance() / spread


@dataclass(frozen=True)
class _Factored:
    """L D L^T of many small symmetric positive systems at once, each entry an array."""

    lower: list[list[Array]]
    """The entries of each line left of the diagonal, which is 1."""
    diagonal: list[Array]

    def solve(self, right: list[Array]) -> list[Array]:
        right = list(right)
        for k, line in enumerate(self.lower):
            for j, entry in enumerate(line):
                right[k] = right[k] - entry * right[j]
        right = [r / d for r, d in zip(right, self.diagonal, strict=True)]
        for k in reversed(range(len(right))):
            for below in range(k + 1, len(right)):
                right[k] = right[k] - self.lower[below][k] * right[below]
        return right

    def slope_sd(self) -> Array:
        """Standard deviation of the second and third coefficients, the larger, where those behind them are known."""
        return 1 / jnp.sqrt(jnp.minimum(self.diagonal[1], self.diagonal[2]))

    def first_variance(self) -> Array:
        """The first diagonal entry of the inverse: the variance of the first coefficient."""
        one = jnp.ones_like(self.diagonal[0])
        return self.solve([one, *[jnp.zeros_like(one)] * (len(self.diagonal) - 1)])[0]


def _gram(design: list[Array], weight: Float[Array, "k c"]) -> _Factored:
    """The matrix of weighted least squares, with a little of a prior: where rays are few, slopes are none."""
    lower: list[list[Array]] = []
    diagonal: list[Array] = []
    for k, p in enumerate(design):
        # Entries of L times D, then of L: line k needs those above it alone.
        line: list[Array] = []
        for j, q in enumerate(design[:k]):
            entry = (weight * p * q).sum(0)
            line.append(entry - sum(line[i] * lower[j][i] for i in range(j)))
        lower.append([entry / d for entry, d in zip(line, diagonal, strict=True)])
        pivot = (weight * p**2).sum(0) + (1e-6, SLOPE_PULL, SLOPE_PULL, BEND_PULL, BEND_PULL)[k]
        diagonal.append(pivot - sum(a * b for a, b in zip(line, lower[k], strict=True)))
    return _Factored(lower, diagonal)


def _moments(design: list[Array], weight: Float[Array, "k c"], y: Float[Array, "k c"]) -> list[Array]:
    return [(weight * p * y).sum(0) for p in design]
