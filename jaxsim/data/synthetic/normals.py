"""Which way the surface looks that a ray has met, by its kind: faces, rounds, leaves, the ground.

Each step is a program of its own: fused into one, XLA on a CPU works out what several components need anew for each.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxsim.data.synthetic.fields import Triple, each, smooth_noise3, unit_vector
from jaxsim.data.synthetic.solids import CROWNS, FACES, GROUND, LEAF_M, POLYHEDRA, ROUNDS, Solids
from jaxsim.data.synthetic.street import Street, ground_normal
from jaxsim.frame import Array


def normals(
    solids: Solids,
    street: Street,
    code: Int[Array, "h w"],
    *,
    solid: Int[Array, "h w"],
    at: Triple,
    kerb: Bool[Array, "h w"],
) -> Triple:
    """Unit normals, outward, by the codes and solids of `raycast`, the places, and where these are a kerb's face."""
    smooth = _round_normal(_conics_at(solids, jnp.clip(solid - POLYHEDRA, 0, ROUNDS + CROWNS - 1)), at)
    ground = ground_normal(street, at[0], at[1], face=kerb)
    return _by_kind(_face_normal(solids, code), smooth, _leafy(smooth, _leaf_turn(at)), ground=ground, solid=solid)


@jax.jit
def _face_normal(solids: Solids, code: Int[Array, "h w"]) -> Triple:
    # The code of a hit with a polyhedron is the number of its plane among all of them.
    plane = jnp.where((code >= 0) & (code < POLYHEDRA * FACES), code, 0)
    return each(lambda i: solids.planes[:, :, i].reshape(-1)[plane])


@jax.jit
def _leafy(normal: Triple, turn: Triple) -> Triple:
    return unit_vector(each(lambda i: normal[i] + 2.2 * turn[i]))


@jax.jit
def _by_kind(
    face: Triple,
    smooth: Triple,
    leafy: Triple,
    *,
    ground: Triple,
    solid: Int[Array, "h w"],
) -> Triple:
    def component(i: int) -> Float[Array, "h w"]:
        normal = jnp.where(solid >= POLYHEDRA + ROUNDS, leafy[i], smooth[i])
        return jnp.where(solid >= GROUND, ground[i], jnp.where(solid < POLYHEDRA, face[i], normal))

    return each(component)


@jax.jit
def _conics_at(solids: Solids, conic: Int[Array, "h w"]) -> list[Float[Array, "h w"]]:
    """Each ray's quadric, row by row, and whether it is a ball."""
    ball = jnp.concatenate([solids.roundness, jnp.ones_like(solids.path_m)])
    return [column[conic] for column in (*solids.conics.reshape(-1, 12).T, ball)]


@jax.jit
def _round_normal(conic: list[Float[Array, "h w"]], at: Triple) -> Triple:
    *rows, ball = conic
    local = [sum(rows[4 * i + j] * at[j] for j in range(3)) + rows[4 * i + 3] for i in range(3)]
    # The quadric's gradient in its own frame is the place itself, without z on a cylinder; A^T takes it to `world`.
    cap = (ball < 0.5) & (jnp.abs(local[2]) > 0.999)
    weight = [jnp.where(cap, 0.0, local[0]), jnp.where(cap, 0.0, local[1]), jnp.where(cap, local[2], ball * local[2])]
    return unit_vector(each(lambda j: sum(rows[4 * i + j] * weight[i] for i in range(3))))


@jax.jit
def _leaf_turn(at: Triple) -> Triple:
    """What to add to a crown's normal: leaves point outwards on the whole, each clump its own way."""
    x, y, z = each(lambda i: at[i] / LEAF_M)
    return each(lambda i: smooth_noise3(x + (17.0, 31.0, 47.0)[i], y, z) - 0.5)
