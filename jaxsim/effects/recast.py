"""What rays meet that do not go where their readings are written: the simulated range image, cast again.

Letters: e, a elevation and azimuth of a cell's centre; u, v slopes of its plane (`scan.slopes_of`), in the basis of the
cell's ray, its left and its up. A ray from origin o (to the beam's own) in direction d meets that plane at
t = (r - o·(1, u, v)) / (d·(1, u, v)): exact on planes, whatever the elevations' spacing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.effects.edits import wrapped
from jaxsim.effects.places import Places, on_turn
from jaxsim.effects.rays import FLOOR, LEAST_M, REFERENCE_M, Array, Rays, Scan
from jaxsim.frame import PolarGrid
from jaxsim.geometry import spans_turn, with_neighbours

BORDER = 2.0
"""Cells beyond the image to which its border's surfaces are continued; rays further out keep their own."""
NOTHING_AT_M = 200.0
"""Where a ray that meets nothing is looked up after its origin moved."""
PASSES = 3
"""How often the cell that a ray meets is looked up, each time from where it met the last one's plane."""


@struct.dataclass
class _Surface:
    """The cells that rays meet and the planes through them."""

    row: Int[Array, "*n"]
    column: Int[Array, "*n"]
    hit: Bool[Array, "*n"]
    range_m: Float[Array, "*n"]
    u: Float[Array, "*n"]
    v: Float[Array, "*n"]


def recast(rays: Rays, scan: Scan, passes: int | Int[Array, ""] = PASSES) -> Rays:
    """Meets the surfaces to which rays were turned and moved (`edits.displace`).

    Differentiable within a cell. The cell is looked up `passes` times, each time where the ray met the last one's
    plane; one is enough where no origin ever moved. Intensity follows the change of angle within the cell by
    Lambert's law.
    """
    turned, moved = rays.turned_rad, rays.moved_m
    row, column, inside = _cell_met(rays, scan, passes)
    surface = _surface(scan, (rays.frame, row, column))
    # Rays that keep their own surface are not displaced on it either.
    known = inside[..., None]
    turn = jnp.where(known, turned, jnp.zeros_like(turned))
    move = jnp.where(known, moved, jnp.zeros_like(moved))
    met, _ = _meet(rays, scan, surface, turned=turn, moved=move)
    return _place(rays, scan, surface, met_m=met, turn=turn)


def is_told(rays: Rays, scan: Scan) -> Bool[Array, "*n"]:
    """Whether the image tells what turned and moved rays meet: they go no farther than BORDER beyond it, and no cell
    beside theirs hits nothing where it hits something, or the other way about. Where between two rays a surface ends is
    in no image."""
    row, column, inside = _cell_met(rays, scan, PASSES)
    cell = (rays.frame, row, column)
    ends = (jnp.isfinite(_beside(scan, cell)) != scan.hit[cell][..., None]).any(-1)
    # Together: XLA would work for seconds to fold one that is 0 for all rays.
    displaced = (jnp.concatenate([rays.turned_rad, rays.moved_m], axis=-1) != 0).any(-1)
    return ~displaced | (inside & ~ends)


def _cell_met(
    rays: Rays, scan: Scan, passes: int | Int[Array, ""]
) -> tuple[Int[Array, "*n"], Int[Array, "*n"], Bool[Array, "*n"]]:
    """Row and column of the cell that each ray meets, and whether it lies in the image, looked up `passes` times."""
    # Which cell is met has no derivative.
    held_turn, held_move = jax.lax.stop_gradient(rays.turned_rad), jax.lax.stop_gradient(rays.moved_m)

    def again(_: Any, cell: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        surface = _surface(scan, (rays.frame, *cell[:2]))
        met, _ = _meet(rays, scan, surface, turned=held_turn, moved=held_move)
        return _look_up(rays, scan, held_turn, moved=held_move, met_m=met)

    # The first look takes the surface for infinitely far: right for turns, and a start for moves.
    cell = _look_up(rays, scan, held_turn, moved=held_move, met_m=jnp.full(rays.range_m.shape, jnp.inf))
    return jax.lax.fori_loop(1, passes, again, cell)


def _look_up(
    rays: Rays, scan: Scan, turned: Float[Array, "*n 2"], *, moved: Float[Array, "*n 3"], met_m: Float[Array, "*n"]
) -> tuple[Int[Array, "*n"], Int[Array, "*n"], Bool[Array, "*n"]]:
    """The cell in whose direction the rays are at range `met_m`, and whether it lies in the image (else the own)."""
    grid = scan.grid
    rows, columns = scan.range_m.shape[1:]
    # In a frame whose x axis has the nominal azimuth.
    sine, cosine = jnp.sin(rays.azimuth_rad), jnp.cos(rays.azimuth_rad)
    elevation = rays.elevation_rad + turned[..., 1]
    # A moved origin shifts a far point's direction by little: at infinity by nothing, which 1 / range says exactly.
    near = 1 / jnp.maximum(met_m, LEAST_M)
    x = jnp.cos(elevation) * jnp.cos(turned[..., 0]) + near * (moved[..., 0] * cosine + moved[..., 1] * sine)
    y = jnp.cos(elevation) * jnp.sin(turned[..., 0]) + near * (moved[..., 1] * cosine - moved[..., 0] * sine)
    z = jnp.sin(elevation) + near * moved[..., 2]
    step = (grid.azimuth_rad[0] - grid.azimuth_rad[-1]) / (columns - 1)
    across = rays.column.astype(jnp.float32) - jnp.arctan2(y, x) / step
    down = _row_of(jnp.arctan2(z, jnp.sqrt(x * x + y * y)), grid)
    full = spans_turn(grid)
    inside = (jnp.abs(down - (rows - 1) / 2) <= (rows - 1) / 2 + BORDER) & (
        full | (jnp.abs(across - (columns - 1) / 2) <= (columns - 1) / 2 + BORDER)
    )
    row = jnp.clip(jnp.round(down).astype(jnp.int32), 0, rows - 1)
    column = on_turn(jnp.round(across).astype(jnp.int32), columns, full)
    # A ray that leaves the image keeps its own surface: nothing is known of what else it may meet.
    return jnp.where(inside, row, rays.row), jnp.where(inside, column, rays.column), inside


def _row_of(elevation_rad: Float[Array, "*n"], grid: PolarGrid) -> Float[Array, "*n"]:
    """The row of an elevation as a float, linear between beams and beyond them."""
    beams_rad, wider_rad = jnp.asarray(grid.elevation_rad), with_neighbours(grid).elevation_rad
    count = beams_rad.shape[0]
    beyond = 4.0 * BORDER
    # Beyond the outermost beams rows go on at their last spacing, so that rays that leave are told by their row.
    first = beams_rad[:1] + beyond * (wider_rad[:1] - beams_rad[:1])
    last = beams_rad[-1:] + beyond * (wider_rad[-1:] - beams_rad[-1:])
    rows = jnp.concatenate(
        [jnp.array([-beyond]), jnp.arange(count, dtype=jnp.float32), jnp.array([count - 1 + beyond])]
    )
    beams = jnp.concatenate([first, beams_rad, last])
    return jnp.interp(-elevation_rad, -beams, rows)


def _surface(scan: Scan, at: Places) -> _Surface:
    """The surfaces of cells."""
    _, row, column = at
    slopes, hit = scan.slopes[at], scan.hit[at]
    return _Surface(row, column, hit, jnp.where(hit, scan.range_m[at], 0.0), slopes[..., 0], slopes[..., 1])


def _beside(scan: Scan, at: Places) -> Float[Array, "*n 4"]:
    """The ranges of cells' neighbours, as `Rays.beside_m` holds them."""
    frame, row, column = at
    rows, columns = scan.range_m.shape[1:]
    to = [1] * row.ndim
    down = jnp.array([0, 0, -1, 1], jnp.int32).reshape(*to, 4)
    right = jnp.array([-1, 1, 0, 0], jnp.int32).reshape(*to, 4)
    i = jnp.clip(row[..., None] + down, 0, rows - 1)
    beside = (frame[..., None], i, on_turn(column[..., None] + right, columns, spans_turn(scan.grid)))
    return jnp.where(scan.hit[beside], scan.range_m[beside], jnp.inf)


def _meet(
    rays: Rays, scan: Scan, surface: _Surface, *, turned: Float[Array, "*n 2"], moved: Float[Array, "*n 3"]
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Range at which the rays meet the planes (NOTHING_AT_M where nothing is hit), and the cosine of incidence over the
    cell's."""
    grid, s = scan.grid, surface
    a, e = grid.azimuth_rad[s.column], grid.elevation_rad[s.row]
    elevation = rays.elevation_rad + turned[..., 1]
    turn = wrapped(rays.azimuth_rad - a + turned[..., 0])
    rise = rays.elevation_rad - e + turned[..., 1]
    # Direction in the basis of the cell's ray; written with differences so that it is exact where there are none.
    versine = 2 * jnp.square(jnp.sin(turn / 2)) * jnp.cos(elevation)
    d = (jnp.cos(rise) - versine * jnp.cos(e), jnp.cos(elevation) * jnp.sin(turn), jnp.sin(rise) + versine * jnp.sin(e))
    x, y = moved[..., 0], moved[..., 1]
    # The cell's own ray started at another height: its beam stands elsewhere in the head.
    z = moved[..., 2] + grid.origin_m[rays.row] - grid.origin_m[s.row]
    ahead = x * jnp.cos(a) + y * jnp.sin(a)
    left = y * jnp.cos(a) - x * jnp.sin(a)
    o = (ahead * jnp.cos(e) + z * jnp.sin(e), left, z * jnp.cos(e) - ahead * jnp.sin(e))
    # The clips bind on surfaces seen edge on alone, where a plane says nothing of the range.
    towards = jnp.clip(d[0] + s.u * d[1] + s.v * d[2], 0.3, 3.0)
    # Where nothing is hit no quotient may come out as not a number, for its derivative would.
    safe = jnp.where(s.hit, s.range_m, 1.0)
    share = jnp.clip((1 - (o[0] + s.u * o[1] + s.v * o[2]) / safe) / towards, 0.3, 3.0)
    return jnp.where(s.hit, safe * share, NOTHING_AT_M), towards


def _place(rays: Rays, scan: Scan, s: _Surface, *, met_m: Float[Array, "*n"], turn: Float[Array, "*n 2"]) -> Rays:
    """The rays on their new surface. What earlier effects did to power, intensity and reading stays on them.

    Intensity follows Lambert's law on the plane, where it depends on the ray's direction alone. On the surface that a
    ray meets anyway it starts from the ray's own, not the cell's: noise on a simulator's normals stays the ray's.
    """
    at = (rays.frame, s.row, s.column)
    range_m = jnp.where(s.hit, met_m, 0.0)
    cell = (rays.frame, rays.row, rays.column)
    same = scan.hit[cell] & s.hit & (scan.semantic[at] == scan.semantic[cell])
    same = same & (scan.instance[at] == scan.instance[cell])
    of = (rays.frame, jnp.where(same, rays.row, s.row), jnp.where(same, rays.column, s.column))
    _, cosine = _meet(rays, scan, _surface(scan, of), turned=turn, moved=jnp.zeros_like(rays.moved_m))
    angle, intensity = scan.incidence_rad[of], scan.intensity[of]
    # First order in the cosine; the arccosine has no derivative head on.
    angle = jnp.clip(angle - (cosine - 1) * jnp.cos(angle) / jnp.maximum(jnp.sin(angle), 0.1), 0.0, 1.5708)
    met = jnp.log(jnp.maximum(intensity, FLOOR)) + jnp.where(s.hit, jnp.log(cosine), 0.0)
    brighter = met - rays.met_log_intensity
    # Power falls with the square of range.
    spread = 2 * jnp.log(_over_reference(range_m) / _over_reference(rays.range_m))
    return replace(
        rays,
        hit=s.hit,
        range_m=range_m,
        incidence_rad=jnp.where(s.hit, angle, scan.incidence_rad[at]),
        semantic=scan.semantic[at],
        instance=scan.instance[at],
        rgb=scan.rgb[at],
        beside_m=_beside(scan, at),
        glare_m=scan.glare_m[at],
        glare_rad=scan.glare_rad[at],
        met_log_intensity=met,
        log_intensity=rays.log_intensity + brighter,
        log_power=rays.log_power + brighter - spread,
        reading_m=rays.reading_m + range_m - rays.range_m,
    )


def _over_reference(range_m: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Range over the reference range, kept positive."""
    return jnp.maximum(range_m, LEAST_M) / REFERENCE_M
