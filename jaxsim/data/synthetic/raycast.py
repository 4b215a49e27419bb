"""Casts the rays of a raster at convex solids and at the street.

The rays of a raster (h, w) are cut into tiles (t) of neighbours (r): a tile has a list of the solids that its rays
may meet (`tiles.py`), and every ray of it is tried on each. A ray is the points o + s d, s > 0; d need not have unit
length: with d of unit depth, s is the depth.

For a convex solid, s runs through an interval [enter, leave]: cut by each plane, by the quadric, by the caps.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.data.synthetic.fields import smooth_noise3, unit_vector, vector
from jaxsim.data.synthetic.solids import CAPACITY, FACES, Solids
from jaxsim.data.synthetic.street import Street, cast_ground, ground_normal
from jaxsim.frame import Array

SKY_M = 1e4
POLYHEDRA, ROUNDS, CROWNS = CAPACITY
GROUND = sum(CAPACITY)
"""Number of the ground among the solids; SKY is the next."""
SKY = GROUND + 1
LEAF_M = 0.22
"""Size of a clump of leaves."""


@struct.dataclass
class TileSolids:
    """Solids that each tile's rays may meet: numbers within their kind, and how many of the list count."""

    polyhedra: Int[Array, "*t polyhedra"]
    rounds: Int[Array, "*t rounds"]
    crowns: Int[Array, "*t crowns"]
    counts: Int[Array, "*t 3"]


@struct.dataclass
class Hit:
    """What each ray meets first."""

    distance: Float[Array, "h w"]
    """Distance in lengths of the ray's direction; SKY_M for the sky."""
    solid: Int[Array, "h w"]
    """Number of the solid, or GROUND, or SKY."""
    normal: Float[Array, "3 h w"]
    """Unit, outward; up in the sky."""
    at: Float[Array, "3 h w"]
    """The place, in `world`."""
    kerb: Bool[Array, "h w"]
    """The ground's hit is a kerb's face."""


@partial(jax.jit, static_argnames="tile")
def nearest_hits(
    solids: Solids,
    street: Street,
    *,
    origin: Float[Array, "3 h0 w0"],
    direction: Float[Array, "3 h w"],
    candidates: TileSolids,
    tile: tuple[int, int],
) -> Hit:
    """Nearest hit of every ray of a raster; `origin` may have 1 in place of h or w."""
    distance, code = cast_solids(solids, origin, direction, candidates=candidates, tile=tile)
    # The ground is no solid: its height is a formula of the place.
    ground, meets, face = cast_ground(street, origin, direction)
    nearer = meets & (ground < distance)
    distance = jnp.where(nearer, ground, distance)
    solid = jnp.where(nearer, GROUND, jnp.where(code < 0, SKY, code // FACES))
    at = origin + distance[None] * direction

    # The code of a hit with a polyhedron is the number of its plane among all of them.
    planes = solids.planes[:, :, :3].reshape(-1, 3)
    flat = planes[jnp.where((code >= 0) & (solid < POLYHEDRA), code, 0)]
    conic = jnp.clip(solid - POLYHEDRA, 0, ROUNDS + CROWNS - 1)
    normal = _round_normal(solids, conic, at)
    normal = jnp.where((solid >= POLYHEDRA + ROUNDS)[None], _leaf_normal(at, normal), normal)
    normal = jnp.where((solid < POLYHEDRA)[None], jnp.moveaxis(flat, -1, 0), normal)
    normal = jnp.where((solid >= GROUND)[None], ground_normal(street, at[0], at[1], face=face), normal)
    return Hit(distance, solid, normal, at, nearer & face)


def cast_solids(
    solids: Solids,
    origin: Float[Array, "3 h0 w0"],
    direction: Float[Array, "3 h w"],
    *,
    candidates: TileSolids,
    tile: tuple[int, int],
) -> tuple[Float[Array, "h w"], Int[Array, "h w"]]:
    """Nearest hit with a solid and its code, FACES * solid + face; SKY_M and a negative code where there is none.

    `candidates` lists the tiles of the raster row by row. One row of tiles is worked on at a time: it stays in the
    cache, and needs as many trials as its fullest tile.
    """
    size = direction.shape[1:]
    rays = _tiled(direction, tile)
    listed = jax.tree.map(lambda leaf: leaf.reshape(rays.shape[0], rays.shape[2], *leaf.shape[1:]), candidates)
    # A camera has one origin for all rays, which need not be cut into tiles.
    if origin.shape[1:] == (1, 1):
        best = jax.lax.map(lambda row: _cast_row(solids, origin, row[0], candidates=row[1]), (rays, listed))
    else:
        starts = _tiled(jnp.broadcast_to(origin, direction.shape), tile)
        best = jax.lax.map(lambda row: _cast_row(solids, row[0], row[1], candidates=row[2]), (starts, rays, listed))
    distance, code = best
    return _untiled(distance, tile, size), _untiled(code, tile, size)


def _tiled(raster: Float[Array, "3 h w"], tile: tuple[int, int]) -> Float[Array, "down 3 across r"]:
    _, h, w = raster.shape
    raster = jnp.pad(raster, ((0, 0), (0, -h % tile[0]), (0, -w % tile[1])), mode="edge")
    down, across = raster.shape[1] // tile[0], raster.shape[2] // tile[1]
    cut = raster.reshape(3, down, tile[0], across, tile[1]).transpose(1, 0, 3, 2, 4)
    return cut.reshape(down, 3, across, tile[0] * tile[1])


def _untiled(cut: Array, tile: tuple[int, int], size: tuple[int, ...]) -> Array:
    down, across, _ = cut.shape
    raster = cut.reshape(down, across, *tile).transpose(0, 2, 1, 3)
    return raster.reshape(down * tile[0], across * tile[1])[: size[0], : size[1]]


def _cast_row(
    solids: Solids, origin: Float[Array, "3 t0 r0"], direction: Float[Array, "3 t r"], *, candidates: TileSolids
) -> tuple[Float[Array, "t r"], Int[Array, "t r"]]:
    shape = direction.shape[1:]
    best = (jnp.full(shape, SKY_M, jnp.float32), jnp.full(shape, -1, jnp.int32))

    def polyhedra(k: Int[Array, ""], best):
        number = candidates.polyhedra[:, k]
        enter, face = enter_polyhedron(origin, direction, solids.planes[number])
        return _nearer(best, enter, number[:, None] * FACES + face)

    def rounds(k: Int[Array, ""], best):
        number = candidates.rounds[:, k]
        enter = enter_round(
            origin, direction, solids.conics[number], roundness=solids.roundness[number], bore=solids.bore[number]
        )
        return _nearer(best, enter, (number[:, None] + POLYHEDRA) * FACES)

    def crowns(k: Int[Array, ""], best):
        number = candidates.crowns[:, k]
        enter = enter_crown(origin, direction, solids.conics[number + ROUNDS], path_m=solids.path_m[number])
        return _nearer(best, enter, (number[:, None] + POLYHEDRA + ROUNDS) * FACES)

    # All tiles of a row go through their candidates together.
    most = candidates.counts.max(axis=0)
    for kind, body in enumerate((polyhedra, rounds, crowns)):
        best = jax.lax.fori_loop(0, most[kind], body, best)
    return best


def _nearer(best, enter: Float[Array, "t r"], code: Int[Array, "..."]):
    distance, codes = best
    wins = enter < distance
    return jnp.where(wins, enter, distance), jnp.where(wins, code, codes)


@jax.jit
def enter_polyhedron(
    origin: Float[Array, "3 t0 r0"], direction: Float[Array, "3 t r"], planes: Float[Array, "t faces 4"]
) -> tuple[Float[Array, "t r"], Int[Array, "t r"]]:
    """Where each ray enters its tile's polyhedron, SKY_M if it does not, and through which face."""
    shape = direction.shape[1:]
    enter, leave = jnp.full(shape, -SKY_M, jnp.float32), jnp.full(shape, SKY_M, jnp.float32)
    face = jnp.zeros(shape, jnp.int32)
    for f in range(FACES):
        nx, ny, nz, w = jnp.unstack(planes[:, f, :, None], axis=1)
        towards = nx * direction[0] + ny * direction[1] + nz * direction[2]
        # n.(o + s d) = w at s = (w - n.o) / (n.d); inside is from the last entry to the first exit.
        room = w - (nx * origin[0] + ny * origin[1] + nz * origin[2])
        s = room / towards
        later = (towards < 0.0) & (s > enter)
        enter, face = jnp.where(later, s, enter), jnp.where(later, f, face)
        leave = jnp.where((towards > 0.0) & (s < leave), s, leave)
        # A ray along a plane, on its outer side, never enters.
        leave = jnp.where((towards == 0.0) & (room < 0.0), -SKY_M, leave)
    return jnp.where((enter < leave) & (enter > 0.0), enter, SKY_M), face


def _span(
    origin: Float[Array, "3 t0 r0"],
    direction: Float[Array, "3 t r"],
    conic: Float[Array, "t 3 4"],
    *,
    weight: Float[Array, "..."],
) -> tuple[list, list, Float[Array, "t r"], Float[Array, "t r"]]:
    """Rays (origin, direction) in the solid's own units, and where they enter and leave its quadric.

    Rays that miss it enter at SKY_M and leave at -SKY_M. `weight` of the third axis: 1 for a ball, 0 for a cylinder.
    """

    def in_frame(v: Float[Array, "3 ..."], *, shift: bool) -> list:
        rows = []
        for i in range(3):
            a, b, c, d = jnp.unstack(conic[:, i, :, None], axis=1)
            rows.append(a * v[0] + b * v[1] + c * v[2] + (d if shift else 0.0))
        return rows

    q, p = in_frame(origin, shift=True), in_frame(direction, shift=False)
    # Seen from the point of closest approach, nothing large cancels: a thin pole 60 m away needs that in float32.
    length2 = jnp.maximum(p[0] * p[0] + p[1] * p[1] + weight * p[2] * p[2], 1e-12)
    middle = -(q[0] * p[0] + q[1] * p[1] + weight * q[2] * p[2]) / length2
    x, y = q[0] + middle * p[0], q[1] + middle * p[1]
    z = q[2] + middle * p[2]
    inside = 1.0 - (x * x + y * y + weight * z * z)
    reach = jnp.sqrt(jnp.maximum(inside, 0.0) / length2)
    met = inside > 0.0
    return q, p, jnp.where(met, middle - reach, SKY_M), jnp.where(met, middle + reach, -SKY_M)


@jax.jit
def enter_round(
    origin: Float[Array, "3 t0 r0"],
    direction: Float[Array, "3 t r"],
    conic: Float[Array, "t 3 4"],
    *,
    roundness: Float[Array, " t"],
    bore: Float[Array, " t"],
) -> Float[Array, "t r"]:
    """Where each ray enters its tile's ball or capped cylinder; SKY_M if it does not.

    A ring is thin: a ray that enters its cap within the bore passes.
    """
    q, p, enter, leave = _span(origin, direction, conic, weight=roundness[:, None])
    along = jnp.where(jnp.abs(p[2]) < 1e-12, 1e-12, p[2])
    # The caps are the planes z = -1 and z = 1 of the solid's own frame.
    one, other = (-1.0 - q[2]) / along, (1.0 - q[2]) / along
    cap = jnp.minimum(one, other)
    leave = jnp.minimum(leave, jnp.maximum(one, other))
    x, y = q[0] + cap * p[0], q[1] + cap * p[1]
    passes = (cap > enter) & (x * x + y * y < (bore * bore)[:, None])
    enter = jnp.maximum(enter, cap)
    return jnp.where((enter < leave) & (enter > 0.0) & ~passes, enter, SKY_M)


@jax.jit
def enter_crown(
    origin: Float[Array, "3 t0 r0"],
    direction: Float[Array, "3 t r"],
    conic: Float[Array, "t 3 4"],
    *,
    path_m: Float[Array, " t"],
) -> Float[Array, "t r"]:
    """Where a leaf stops each ray in its tile's crown; SKY_M where it gets through.

    The free path is -path_m ln u (Beer-Lambert), with u noise that belongs to the place where the ray enters.
    """
    _, _, enter, leave = _span(origin, direction, conic, weight=jnp.float32(1.0))
    at = [jnp.clip(origin[i] + enter * direction[i], -SKY_M, SKY_M) / LEAF_M for i in range(3)]
    bough, clump = smooth_noise3(*(0.35 * c for c in at)), smooth_noise3(*at)
    leaf = smooth_noise3(*(3.1 * c for c in at))
    # Interpolated noise gathers about 1/2: stretch it over (0, 1).
    u = jnp.clip(1.9 * (0.4 * bough + 0.35 * clump + 0.25 * leaf - 0.5) + 0.5, 0.01, 0.98)
    unit = 1.0 / jnp.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
    stop = enter - path_m[:, None] * jnp.log(u) * unit
    return jnp.where((stop < leave) & (enter > 0.0), stop, SKY_M)


def _round_normal(solids: Solids, conic: Int[Array, "h w"], at: Float[Array, "3 h w"]) -> Float[Array, "3 h w"]:
    rows = solids.conics.reshape(-1, 12)[conic]
    local = [sum(rows[..., 4 * i + j] * at[j] for j in range(3)) + rows[..., 4 * i + 3] for i in range(3)]
    # The quadric's gradient in its own frame is the place itself, without z on a cylinder; A^T takes it to `world`.
    ball = jnp.concatenate([solids.roundness, jnp.ones_like(solids.path_m)])[conic]
    cap = (ball < 0.5) & (jnp.abs(local[2]) > 0.999)
    weight = [jnp.where(cap, 0.0, local[0]), jnp.where(cap, 0.0, local[1]), jnp.where(cap, local[2], ball * local[2])]
    return unit_vector(vector(*(sum(rows[..., 4 * i + j] * weight[i] for i in range(3)) for j in range(3))))


def _leaf_normal(at: Float[Array, "3 h w"], normal: Float[Array, "3 h w"]) -> Float[Array, "3 h w"]:
    """A crown's leaves point outwards on the whole, each clump its own way."""
    x, y, z = at / LEAF_M
    turn = vector(*(smooth_noise3(x + shift, y, z) - 0.5 for shift in (17.0, 31.0, 47.0)))
    return unit_vector(normal + 2.2 * turn)
