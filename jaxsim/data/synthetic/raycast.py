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

from jaxsim.data.synthetic.fields import Starts, Triple, at_once, each, smooth_noise3
from jaxsim.data.synthetic.normals import normals
from jaxsim.data.synthetic.solids import FACES, GROUND, LEAF_M, POLYHEDRA, ROUNDS, SKY, Solids
from jaxsim.data.synthetic.street import Street, cast_ground
from jaxsim.frame import Array

SKY_M = 1e4
TOGETHER = 4
"""Tiles whose rays are cast at a time: they stay in the cache, and need as many trials as the fullest of them."""


@struct.dataclass
class TileSolids:
    """Solids that each tile's rays may meet: numbers within their kind, and how many of the list count.

    Tiles stand by how many solids they list, so that neighbours here need about as many trials.
    """

    tile: Int[Array, "*t"]
    """Numbers of the tiles, which are counted row by row."""
    polyhedra: Int[Array, "*t polyhedra"]
    rounds: Int[Array, "*t rounds"]
    crowns: Int[Array, "*t crowns"]
    counts: Int[Array, "*t 3"]


@struct.dataclass
class Hit:
    """What each ray meets first."""

    distance: Float[Array, "*r"]
    """Distance in lengths of the ray's direction; SKY_M for the sky."""
    solid: Int[Array, "*r"]
    """Number of the solid, or GROUND, or SKY."""
    normal: Triple
    """Unit, outward; up in the sky."""
    at: Triple
    """The place, in `world`."""
    kerb: Bool[Array, "*r"]
    """The ground's hit is a kerb's face."""


def nearest_hits(
    solids: Solids,
    street: Street,
    *,
    origin: Starts,
    direction: Triple,
    candidates: TileSolids,
    tile: tuple[int, int],
) -> Hit:
    """Nearest hit of every ray of a raster; `origin` may have 1 in place of h or w.

    A sequence of jitted steps: in one program XLA would work out the place of a hit anew for whatever reads it.
    """
    met = cast_solids(solids, origin, direction, candidates=candidates, tile=tile)
    return hits_of(solids, street, met, origin=origin, direction=direction)


def hits_of(
    solids: Solids,
    street: Street,
    met: tuple[Float[Array, "h w"], Int[Array, "h w"]],
    *,
    origin: Starts,
    direction: Triple,
) -> Hit:
    """Nearest hits of rays, the ground included, of which `cast_solids` or `cast_tiles` say where solids are `met`."""
    distance, code = met
    distance, solid, at, kerb = _with_ground(street, origin, direction, distance=distance, code=code)
    return Hit(distance, solid, normals(solids, street, code, solid=solid, at=at, kerb=kerb), at, kerb)


@jax.jit
def _with_ground(
    street: Street,
    origin: Starts,
    direction: Triple,
    *,
    distance: Float[Array, "h w"],
    code: Int[Array, "h w"],
) -> tuple[Float[Array, "h w"], Int[Array, "h w"], Triple, Bool[Array, "h w"]]:
    """Distances, solids and places of what is met first, the ground included; and whether that is a kerb's face."""
    # The ground is no solid: its height is a formula of the place.
    ground, meets, face = cast_ground(street, origin, direction)
    nearer = meets & (ground < distance)
    distance = jnp.where(nearer, ground, distance)
    solid = jnp.where(nearer, GROUND, jnp.where(code < 0, SKY, code // FACES))
    return distance, solid, each(lambda i: origin[i] + distance * direction[i]), nearer & face


@partial(jax.jit, static_argnames="tile")
def cast_solids(
    solids: Solids,
    origin: Starts,
    direction: Triple,
    *,
    candidates: TileSolids,
    tile: tuple[int, int],
) -> tuple[Float[Array, "h w"], Int[Array, "h w"]]:
    """Nearest hit with a solid and its code, FACES * solid + face; SKY_M and a negative code where there is none."""
    size = direction[0].shape
    rays = each(lambda i: _tiled(direction[i], tile)[candidates.tile])
    # A camera has one origin for all rays, which need not be cut into tiles.
    alone = origin[0].shape == (1, 1)
    starts = origin if alone else each(lambda i: _tiled(jnp.broadcast_to(origin[i], size), tile)[candidates.tile])
    distance, code = cast_tiles(solids, starts, rays, candidates=candidates)
    place = jnp.argsort(candidates.tile)
    return _untiled(distance[place], tile, size), _untiled(code[place], tile, size)


def _tiled(raster: Float[Array, "h w"], tile: tuple[int, int]) -> Float[Array, "t r"]:
    h, w = raster.shape
    raster = jnp.pad(raster, ((0, -h % tile[0]), (0, -w % tile[1])), mode="edge")
    down, across = raster.shape[0] // tile[0], raster.shape[1] // tile[1]
    cut = raster.reshape(down, tile[0], across, tile[1]).transpose(0, 2, 1, 3)
    return cut.reshape(down * across, tile[0] * tile[1])


def _untiled(cut: Float[Array, "t r"] | Int[Array, "t r"], tile: tuple[int, int], size: tuple[int, ...]) -> Array:
    across = -(-size[1] // tile[1])
    raster = cut.reshape(-1, across, *tile).transpose(0, 2, 1, 3)
    return raster.reshape(-1, across * tile[1])[: size[0], : size[1]]


@jax.jit
def cast_tiles(
    solids: Solids, origin: Starts, direction: Triple, *, candidates: TileSolids
) -> tuple[Float[Array, "t r"], Int[Array, "t r"]]:
    """The same of rays that stand tile by tile, as in `candidates`."""
    count = len(candidates.tile)
    some = at_once(count, TOGETHER)

    def grouped(leaf: Array) -> Array:
        leaf = jnp.pad(leaf, ((0, -count % some), *((0, 0),) * (leaf.ndim - 1)), mode="edge")
        return leaf.reshape(-1, some, *leaf.shape[1:])

    direction, candidates = jax.tree.map(grouped, (direction, candidates))
    if origin[0].shape == (1, 1):
        done = jax.lax.map(lambda of: _cast_together(solids, origin, of[0], candidates=of[1]), (direction, candidates))
    else:
        rays = jax.tree.map(grouped, origin), direction, candidates
        done = jax.lax.map(lambda of: _cast_together(solids, of[0], of[1], candidates=of[2]), rays)
    return tuple(leaf.reshape(-1, leaf.shape[-1])[:count] for leaf in done)


def _cast_together(
    solids: Solids, origin: Starts, direction: Triple, *, candidates: TileSolids
) -> tuple[Float[Array, "t r"], Int[Array, "t r"]]:
    """Nearest hits of a few tiles, and their codes."""
    shape = direction[0].shape

    def polyhedra(number: Int[Array, " t"]) -> tuple[Array, Array]:
        planes = solids.planes[number]
        face = entered_face(origin, direction, planes)
        return enter_polyhedron(origin, direction, planes), number[:, None] * FACES + face

    def rounds(number: Int[Array, " t"]) -> tuple[Array, Array]:
        form = {"roundness": solids.roundness[number], "bore": solids.bore[number]}
        enter = enter_round(origin, direction, solids.conics[number], **form)
        return enter, jnp.broadcast_to((number[:, None] + POLYHEDRA) * FACES, shape)

    def crowns(number: Int[Array, " t"]) -> tuple[Array, Array]:
        enter = enter_crown(origin, direction, solids.conics[number + ROUNDS], path_m=solids.path_m[number])
        return enter, jnp.broadcast_to((number[:, None] + POLYHEDRA + ROUNDS) * FACES, shape)

    best = last = (jnp.full(shape, SKY_M, jnp.float32), jnp.full(shape, -1, jnp.int32))
    lists = (candidates.polyhedra, candidates.rounds, candidates.crowns)
    for kind, (enter, listed) in enumerate(zip((polyhedra, rounds, crowns), lists, strict=True)):

        def trial(k: Int[Array, ""], state, *, enter=enter, listed=listed):
            # A trial's answer counts in the next: compared at once, XLA on a CPU would work it out for both results.
            best, last = state
            return _nearer(best, last), enter(listed[:, k])

        best, last = jax.lax.fori_loop(0, candidates.counts[:, kind].max(), trial, (best, last))
    return _nearer(best, last)


def _nearer(best: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
    wins = other[0] < best[0]
    return jnp.where(wins, other[0], best[0]), jnp.where(wins, other[1], best[1])


def _faces(
    origin: Starts, direction: Triple, planes: Float[Array, "t faces 4"]
) -> list[tuple[Float[Array, "t r"], Float[Array, "..."]]]:
    """Of each face, n.d and w - n.o: a ray meets its plane, n.(o + s d) = w, at s = (w - n.o) / (n.d)."""
    faces = []
    for f in range(FACES):
        nx, ny, nz, w = jnp.unstack(planes[:, f, :, None], axis=1)
        towards = nx * direction[0] + ny * direction[1] + nz * direction[2]
        faces.append((towards, w - (nx * origin[0] + ny * origin[1] + nz * origin[2])))
    return faces


@jax.jit
def enter_polyhedron(origin: Starts, direction: Triple, planes: Float[Array, "t faces 4"]) -> Float[Array, "t r"]:
    """Where each ray enters its tile's polyhedron, SKY_M if it does not."""
    shape = direction[0].shape
    enter, leave = jnp.full(shape, -SKY_M, jnp.float32), jnp.full(shape, SKY_M, jnp.float32)
    # Inside is from the last entry to the first exit. Each quotient has one use, so that all is one loop over rays.
    for towards, room in _faces(origin, direction, planes):
        into = towards < 0.0
        enter = jnp.maximum(enter, jnp.where(into, room, SKY_M) / jnp.where(into, towards, -1.0))
        # A ray along a plane never leaves through it, and on its outer side never enters.
        away = jnp.where(into, 1.0, jnp.where(towards == 0.0, 1e-30, towards))
        leave = jnp.minimum(leave, jnp.where(into, SKY_M, room) / away)
    return jnp.where(jnp.minimum(leave - enter, enter) > 0.0, enter, SKY_M)


@jax.jit
def entered_face(origin: Starts, direction: Triple, planes: Float[Array, "t faces 4"]) -> Int[Array, "t r"]:
    """Through which face each ray enters its tile's polyhedron, if it does."""
    shape = direction[0].shape
    # The last entry, as a fraction whose parts are negative.
    over, under = jnp.full(shape, SKY_M, jnp.float32), jnp.full(shape, -1.0, jnp.float32)
    face = jnp.zeros(shape, jnp.int32)
    for f, (towards, room) in enumerate(_faces(origin, direction, planes)):
        later = jnp.where(towards < 0.0, room * under - over * towards, -1.0) > 0.0
        over, under = jnp.where(later, room, over), jnp.where(later, towards, under)
        face = jnp.where(later, f, face)
    return face


def _span(
    origin: Starts,
    direction: Triple,
    conic: Float[Array, "t 3 4"],
    *,
    weight: Float[Array, "..."],
) -> tuple[list, list, Float[Array, "t r"], Float[Array, "t r"]]:
    """Rays (origin, direction) in the solid's own units, and where they enter and leave its quadric.

    Rays that miss it enter at SKY_M and leave at -SKY_M. `weight` of the third axis: 1 for a ball, 0 for a cylinder.
    """

    def in_frame(v: Starts, *, shift: bool) -> list:
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
    origin: Starts,
    direction: Triple,
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
    origin: Starts,
    direction: Triple,
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
    per_m = 1.0 / jnp.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
    stop = enter - path_m[:, None] * jnp.log(u) * per_m
    return jnp.where((stop < leave) & (enter > 0.0), stop, SKY_M)
