"""Windows: each ray with its neighbours, and which of them may lie on its surface."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.discover.model.noise_levels import STEEPEST_COSINE
from jaxsim.effects.rays import Scan, spans_turn
from jaxsim.frame import Array

REACH_RAD = np.deg2rad(2.5)
"""Half width of the windows in which surfaces are made smooth."""
LEAST_HALF, MOST_HALF = 4, 16
"""The same in columns, at least and at most."""
ROWS, COLUMNS = 2, 9
"""Rows to each side, and columns in all, of which a window is made."""
STEEPEST_SLOPE = 3.0
"""Tangent of the steepest incidence at which a neighbour of a row is looked for on a ray's own surface ..."""
JUMP = 0.03
"""... beside a step of this share of 1 / range."""

OTHER_MATERIAL, OTHER_MATERIAL_SD = 0.3, 3.0
"""Intensities that differ by more than this share of them and so many times their noise are of other materials."""


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
        """The same with squares, for cylinders and other surfaces that bend."""
        return [*self.design, self.left**2, self.up**2]


def half_width(scan: Scan) -> int:
    """Columns to each side that a window has."""
    # Steps as turns: the seam of a full turn is one step too, not a jump of 360 degrees.
    azimuth = np.asarray(scan.grid.azimuth_rad, float)
    step = float(np.median(np.abs(np.angle(np.exp(1j * np.diff(azimuth))))))
    return int(np.clip(round(REACH_RAD / max(step, 1e-6)), LEAST_HALF, MOST_HALF))


def window_of(
    scan: Scan,
    frame: Int[Array, ""],
    row: Int[Array, ""],
    *,
    half: int,
    by_cosine: bool,
    reach: Float[Array, ""],
    intensity_sd: Float[Array, " 2"],
) -> Window:
    """The windows of a row of a frame, `half` columns and `reach` radians to each side; `by_cosine` divides
    intensities by the cosine of the incidence. `intensity_sd` is their noise: the same for all, and as a share."""
    azimuth, elevation = scan.grid.azimuth_rad, scan.grid.elevation_rad
    rows, columns = len(elevation), len(azimuth)
    across = sorted({round(k) for k in np.linspace(-half, half, COLUMNS)})
    up_by = np.repeat(np.arange(-ROWS, ROWS + 1), len(across))[:, None]
    left_by = np.tile(across, 2 * ROWS + 1)[:, None]
    column = np.arange(columns) + left_by
    # A full turn goes on at its other end; a sector has nothing beyond its ends.
    beyond = jnp.asarray((column < 0) | (column >= columns)) & ~spans_turn(scan.grid)
    beyond = beyond | (row + up_by < 0) | (row + up_by >= rows)
    at = jnp.clip(row + up_by, 0, rows - 1), column % columns

    def own(raster: Array) -> Array:
        return raster[frame, row][None]

    def there(raster: Array) -> Array:
        return raster[frame, *at]

    # 1 / range of a plane is linear in the ray's direction, whatever its slope: a plane is a straight line here.
    ratio = jnp.maximum(own(scan.range_m), 0.1) / jnp.maximum(there(scan.range_m), 0.1)
    e, own_e = elevation[at[0]], elevation[row]
    turn = left_by.astype(np.float32) * (azimuth[1] - azimuth[0])
    # On level ground 1 / range goes with the sine of the elevation, from row to row by a large step.
    ground = jnp.sin(e) / jnp.minimum(jnp.sin(own_e), -1e-3)
    near = (jnp.abs(ratio - 1) < STEEPEST_SLOPE * jnp.abs(turn) + JUMP) | (jnp.abs(ratio - ground) < JUMP)
    alike = (there(scan.semantic) == own(scan.semantic)) & (there(scan.instance) == own(scan.instance))
    angle = there(scan.incidence_rad)
    cosine = jnp.maximum(jnp.cos(angle), STEEPEST_COSINE) if by_cosine else jnp.ones_like(angle)
    level = there(scan.intensity) / cosine
    middle = len(left_by) // 2
    own_level, own_cosine = level[middle][None], cosine[middle][None]
    # A pane a hand's breadth behind its wall is told by what it reflects; ranges alone would mix the two.
    constant = intensity_sd[0] ** 2 * (1 / cosine**2 + 1 / own_cosine**2)
    noise = jnp.sqrt(constant + intensity_sd[1] ** 2 * (level**2 + own_level**2))
    unlike = jnp.abs(level - own_level) > OTHER_MATERIAL * (level + own_level) / 2 + OTHER_MATERIAL_SD * noise
    # The neighbour's direction in axes of the ray itself, so that every window is solved alike.
    forward = jnp.cos(e) * jnp.cos(turn)
    return Window(
        ratio=ratio,
        level=level,
        cosine=cosine,
        angle=angle,
        same=there(scan.hit) & own(scan.hit) & alike & near & ~unlike & ~beyond,
        along=jnp.broadcast_to(jnp.cos(own_e) * forward + jnp.sin(own_e) * jnp.sin(e), ratio.shape),
        left=jnp.broadcast_to(jnp.cos(e) * jnp.sin(turn) / reach, ratio.shape),
        up=jnp.broadcast_to((jnp.cos(own_e) * jnp.sin(e) - jnp.sin(own_e) * forward) / reach, ratio.shape),
    )
